"""Children of this process: files of the working directory are data to them, never code."""

import subprocess
import sys
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

pytestmark = pytest.mark.slow

# What the children import of Python itself, and this package by its name.
SHADOWED = ("random", "resource", "pickle", "subprocess", "aerokernels", "distributed", "numpy")
SWEEP = (
    "import aerokernels\nsmall = {'strehl.ray_count': 64, 'beam.ray_count': 4, 'receiver.return_factor': 'none'}\n"
    "done = aerokernels.sweep('wind-tunnel-static', {'target.tilt': [0.0]}, settings=small, executor='%s', workers=1)\n"
    "assert not done.failed.any()"
)


def write_density(path: Path, peak: float = 0.1) -> None:
    """A smooth lump of `peak` more than 1.2 kg/m3 at 21 x 21 x 21 points."""
    x = np.linspace(-0.05, 0.05, 21)
    radius2 = x[:, None, None] ** 2 + x[None, :, None] ** 2 + x[None, None, :] ** 2
    with h5netcdf.File(path, "w") as file:
        file.dimensions = dict.fromkeys("xyz", 21)
        for name in "xyz":
            file.create_variable(name, (name,), "f8")[:] = x
            file.variables[name].attrs["units"] = "m"
        file.create_variable("rho", ("x", "y", "z"), "f8")[:] = 1.2 + peak * np.exp(-radius2 / 0.02**2)
        file.variables["rho"].attrs["units"] = "kg m-3"


@pytest.mark.parametrize("started", ["reader", "local", "dask"])
def test_a_strangers_folder_is_no_code(started: str, tmp_path: Path):
    """Modules of that folder leave a mark and raise: each child ran the first that it imported."""
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in SHADOWED:
        (folder / f"{name}.py").write_text("open('mark', 'a').write(__file__); raise ImportError('shadowed')")
    write_density(folder / "rho.nc")
    if started == "dask":
        pytest.importorskip("distributed")
    arguments = ["-m", "aerokernels", "fields", "rho.nc"] if started == "reader" else ["-c", SWEEP % started]
    done = subprocess.run(
        [sys.executable, "-P", *arguments], cwd=folder, capture_output=True, encoding="utf-8", timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert not (folder / "mark").exists(), (folder / "mark").read_text()


def test_a_reader_follows_the_caller_to_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file of the same name in the folder where the reader was started would be read, or none be found."""
    from aerokernels import flow

    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        write_density(Path("rho.nc"), peak=0.1 if name == "one" else 0.2)
        found = flow.read("rho.nc").density.max()
        assert abs(found - (1.3 if name == "one" else 1.4)) < 1e-9
