"""What others wrote: sizes are held against the memory before anything is read; drawn inputs are taken or refused.

The corpus are draws that failed once, by kind and seed; scripts/fuzz_inputs draws a million.
"""

import random
import warnings
from pathlib import Path

import numpy as np
import pytest

from aerokernels import room
from aerokernels.flow import open_series, read
from aerokernels.hardware import export as exporting
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.recorded import recorded_labels
from aerokernels.scene import Scene, SceneError
from aerokernels.schlieren.picture_file import read_picture
from aerokernels.validation import file_draws, input_draws, record_draws

DRAWS = {**input_draws.DRAWS, **record_draws.DRAWS, **file_draws.DRAWS}
CORPUS = {"scene": (8380,), "override": (1018, 5030), "preamble": (1780,), "netcdf": (50,),
          "store": (9, 13, 18, 21, 30, 41, 61), "sweep": (41,), "row": (109, 149)}  # fmt: skip


@pytest.mark.parametrize("kind", DRAWS)
def test_drawn_inputs_are_taken_or_refused_in_one_line(kind: str, tmp_path: Path):
    """The draws look at what comes out; some of each kind must be taken, or nothing but the first check is tested."""
    taken = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in (*CORPUS.get(kind, ()), *range(10_000, 10_040)):
            taken += DRAWS[kind](random.Random(seed), tmp_path)
    assert taken


def announcing(path: Path, name: str, *small: str) -> Path:
    """A NetCDF file of a few kilobytes that announces 2**45 numbers along z, and as many places."""
    import h5py

    with h5py.File(path, "w") as file:
        made = file.create_dataset(name, (2,) * len(small) + (2**45,), "f8", chunks=(1,) * len(small) + (1024,))
        file.create_dataset("z", (2**45,), "f8", chunks=(1024,)).make_scale("z")
        made.dims[len(small)].attach_scale(file["z"])
        for number, axis in enumerate(small):
            file.create_dataset(axis, data=np.arange(2.0)).make_scale(axis)
            made.dims[number].attach_scale(file[axis])
    assert path.stat().st_size < 100_000
    return path


def test_a_small_file_that_announces_terabytes_is_refused_before_it_is_read(tmp_path: Path):
    """Each reader of NetCDF; HDF5 gives such a file as zeros, so that a system without this check is out of memory."""
    for reader in (recorded_labels, read):
        path = announcing(tmp_path / f"{reader.__name__}.nc", "voltage")
        with pytest.raises(ValueError, match=rf"{path.name}.* announces 562\.9 TB and there is room for"):
            reader(path)
    with pytest.raises(ValueError, match=r"series\.nc: its list of coordinates announces 281\.5 TB"):
        open_series(announcing(tmp_path / "series.nc", "density", "time"), ambient_density=1.0)


def test_a_snapshot_and_a_picture_are_held_against_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Memory for 4 kB: a snapshot of 8 kB, and a picture of 20 x 20 pixels in three copies of float64, are refused."""
    import xarray
    from PIL import Image

    axis = np.arange(32.0)
    rho = xarray.DataArray(np.ones((2, 32, 32)), dims=("time", "y", "z"), name="rho",
                           coords={"time": [0.0, 1.0], "y": axis, "z": axis})  # fmt: skip
    series = open_series(rho, ambient_density=1.0)
    path = tmp_path / "bench.png"
    Image.fromarray(np.arange(400, dtype=np.uint8).reshape(20, 20)).save(path)
    assert series.density(0).shape == (32, 32) and read_picture(path, pixel_size=1e-4, nose=(1, 1))
    monkeypatch.setattr(room, "free_memory", lambda: 8000.0)
    with pytest.raises(ValueError, match=r"a snapshot announces 8\.19 kB and there is room for 4 kB"):
        series.density(0)
    with pytest.raises(ValueError, match=r"picture .*bench\.png: .* announces 9\.6 kB"):
        read_picture(path, pixel_size=1e-4, nose=(1, 1))


def test_one_long_curve_does_not_make_long_rows_of_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Rows are as long as the longest echo: at 100 samples at a time and 40 an echo, two echoes go together."""
    monkeypatch.setattr(exporting, "SAMPLES_AT_ONCE", 100)
    sizes = []
    monkeypatch.setattr(exporting, "_columns_of", lambda block, names: sizes.append(len(block)) or {})
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("p", "frames", {})
        for k in range(5):
            store.add(EchoFrame(k, k, 250, 1.0, 0.0, np.full(40 if k == 4 else 3, k)), k)
        store.commit()
        assert exporting.export(store, tmp_path / "e.nc") == 5
    assert sizes == [2, 2, 1]
    import h5py

    with h5py.File(tmp_path / "e.nc") as file:
        assert file["voltage"].chunks == (2, 40) and file["voltage"][4].tolist() == [4.0] * 40
        assert file["voltage"][1][:3].tolist() == [1.0] * 3 and np.isnan(file["voltage"][1][3:]).all()


def test_a_scene_of_brackets_without_end_is_refused(tmp_path: Path):
    path = tmp_path / "deep.toml"
    path.write_text("a = " + "[" * 100_000, encoding="utf-8")
    with pytest.raises(SceneError, match=r"deep\.toml: tables and lists within one another"):
        Scene.load(path)
    path.write_text("a = " + "9" * 5000, encoding="utf-8")
    with pytest.raises(SceneError, match=r"deep\.toml: not valid TOML"):
        Scene.load(path)
