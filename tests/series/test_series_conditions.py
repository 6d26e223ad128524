"""One ambient density for all files of a series, and a warning where they are of different flow conditions.

A file's own far field is the median of the densities at its upstream end. Turbulence there makes it fluctuate from file
to file, by less than its scatter; a tunnel at another Mach number makes it differ by far more.
"""

import warnings
from pathlib import Path

import numpy as np
import pytest

from aerokernels import flow

X, Y, Z = np.linspace(-0.2, 0.0, 21), np.linspace(-0.05, 0.05, 11), np.linspace(-0.05, 0.05, 11)
WORDS = r"upstream end is 0\.427\d+ kg/m3, in the first snapshot 0\.534\d+ kg/m3, .* in air of 0\.534\d+ kg/m3"


def tunnel(mach: float) -> float:
    return 2e5 / (flow.GAS_CONSTANT_AIR * 300.0) * flow.isentropic(mach).density_ratio


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
def test_another_mach_number_is_told_once(tmp_path: Path, kind: str):
    """Set-up: a tunnel at Mach 2, 2, 2.2 and 2.4. Expected: all in the air of the first, and one warning, of the third.

    Its density is lower by 0.107 kg/m3: over 0.2 m in x, the optical axis, K drho L = 4.8e-6 m, 5.3 waves at 905 nm.
    """
    options = {"spacing": 0.01} if kind == "resampled" else {}
    frame = {} if kind == "plane" else {"frame": "-x"}
    source = write(tmp_path, kind, [tunnel(mach) for mach in (2.0, 2.0, 2.2, 2.4)])
    series = flow.open_series(source, time_step=1.0, **options, **frame)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert series[1].ambient_density == pytest.approx(tunnel(2.0), rel=1e-12)
    with pytest.warns(UserWarning, match=rf"flow_2\.npz: .*{WORDS}: 5\.3 waves along the box") as told:
        assert {field.ambient_density for field in series} == {series.ambient_density}
    assert len(told) == 1 and told[0].filename == __file__


@pytest.mark.parametrize("kind", ["plane", "volume"])
def test_turbulence_at_the_upstream_end_is_no_other_flow(tmp_path: Path, kind: str):
    """Set-up: 5 % of turbulence. Expected: no warning; the medians of the files differ by more than a thousandth wave.

    Also none where the caller gives the ambient density, or where a difference is too small for any optics: 1e-9.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        series = flow.open_series(write(tmp_path, kind, [0.5] * 8, 0.05), time_step=1.0)
        assert len({field.ambient_density for field in series}) == 1
        ends = [float(np.median(field.density[..., -1] if kind == "volume" else field.density)) for field in series]
        assert 2.2e-4 * np.ptp(ends) * 0.1 > 1e-3 * 905e-9
        source = write(tmp_path, kind, [0.5, 0.6])
        given = flow.open_series([tmp_path / f"flow_{k}.npz" for k in (0, 1)], time_step=1.0, ambient_density=0.55)
        assert [field.ambient_density for field in given] == [0.55, 0.55]
        write(tmp_path, kind, [0.5] * 7 + [0.5 * (1.0 + 1e-9)])
        list(flow.open_series(source, time_step=1.0))


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
