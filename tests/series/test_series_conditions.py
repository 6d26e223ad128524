"""One ambient density for all files of a series."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from aerokernels import flow

X, Y, Z = np.linspace(-0.2, 0.0, 21), np.linspace(-0.05, 0.05, 11), np.linspace(-0.05, 0.05, 11)


def write(folder: Path, kind: str, levels, turbulence: float = 0.0) -> Path:
    """Snapshots whose gas has these densities [kg/m3] on average, with random factors around 1."""
    draw = np.random.default_rng(0)
    for number, level in enumerate(levels):
        if kind == "plane":
            shape, places = (len(X), len(Y)), {"x": X, "y": Y}
        else:
            shape, places = (len(X), len(Y), len(Z)), {"x": X, "y": Y, "z": Z}
        density = level * (1.0 + turbulence * draw.standard_normal(shape))
        np.savez(folder / f"flow_{number}.npz", rho=density, **places)
    return folder / "flow_*.npz"


@pytest.mark.parametrize("kind", ["plane", "volume", "resampled"])
def test_all_files_are_in_the_air_of_the_first(tmp_path: Path, kind: str):
    """Set-up: 5 % of turbulence. Expected: the ambient density of the first file; the caller's where it is given."""
    options = {"spacing": 0.01} if kind == "resampled" else {}
    frame = {} if kind == "plane" else {"frame": "-x"}
    source = write(tmp_path, kind, [0.5, 0.5, 0.6], 0.05)
    series = flow.open_series(source, time_step=1.0, **options, **frame)
    assert {field.ambient_density for field in series} == {series.ambient_density}
    assert series.ambient_density == pytest.approx(0.5, rel=0.05)
    held = flow.open_series(source, time_step=1.0, ambient_density=0.55, **options, **frame)
    assert {field.ambient_density for field in held} == {0.55}


def test_density_fields_keep_their_own_ambient_density(tmp_path: Path):
    """Expected: no warning, since each is in its own air; one for all where the caller gives it."""
    write(tmp_path, "plane", [0.5, 0.4])
    fields = [flow.read(tmp_path / f"flow_{k}.npz") for k in (0, 1)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept = flow.open_series(fields, time=[0.0, 1.0])
        assert [field.ambient_density for field in kept] == [0.5, 0.4]
        held = flow.open_series(fields, time=[0.0, 1.0], ambient_density=0.5)
        assert [field.ambient_density for field in held] == [0.5, 0.5]
