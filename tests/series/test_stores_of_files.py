"""Stores of series that are read from files, which may be written again between two runs."""

import os
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels import Disc, flow, optical_series

from .fourier import Fourier

zarr = pytest.importorskip("zarr")

COUNT, SHAPE, SPACING, LOW = 5, (13, 13, 7), 5e-3, (-0.03, -0.03, 0.0)
TIMES = 1e-5 * np.arange(COUNT + 1)
AXES = [low + SPACING * np.arange(size) for low, size in zip(LOW, SHAPE, strict=True)]
PUPIL = Disc(0.02)


def samples(seed: int, time: float) -> np.ndarray:
    return np.asarray(1.2 + 1e-3 * Fourier.random(seed, amplitude=1.0).on_grid(LOW, SPACING, SHAPE, time))


def write(folder: Path, number: int, seed: int) -> None:
    with (folder / f"f{number}.npz").open("wb") as file:  # not compressed: all files have one size
        np.savez(file, rho=samples(seed, TIMES[number]), **dict(zip("xyz", AXES, strict=True)))


def maps(folder: Path, out: Path | None, **more) -> xarray.Dataset:
    series = flow.open_series(folder / "f*.npz", time_step=1e-5, order="xyz")
    return optical_series(series, PUPIL, pixel_count=8, method="linear", out=out, **more)


def plain(store: Path) -> xarray.Dataset:
    found = xarray.open_zarr(store, chunks=None).drop_vars("done")
    del found.attrs["definition"]
    return found


def stamps(store: Path) -> list[int]:
    return [(store / f"opd/c/{k}/0/0").stat().st_mtime_ns for k in range(COUNT)]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    for number in range(COUNT):
        write(folder, number, 1)
    return folder


def test_a_file_that_is_written_again_in_the_middle_is_computed_again(files: Path, tmp_path: Path):
    """Set-up: of a finished store the file of snapshot 2 changes, in its samples alone.

    Expected: the maps of the files as they are, equal to those without a store, and a warning that names the file;
    maps before it are not written again.
    """
    out = tmp_path / "s.zarr"
    first = maps(files, out).load()
    before, size = stamps(out), (files / "f2.npz").stat().st_size
    write(files, 2, 7)
    assert (files / "f2.npz").stat().st_size == size
    with pytest.warns(UserWarning, match=r"s\.zarr: files of snapshot 2 have changed .* those after it, 3 in all"):
        again = maps(files, out).load()
    alone = maps(files, None)
    assert np.array_equal(again.opd, alone.opd, equal_nan=True) and np.array_equal(again.strehl, alone.strehl)
    assert not np.array_equal(again.strehl[2], first.strehl[2])
    after = stamps(out)
    assert after[:2] == before[:2] and (np.array(after[2:]) > before[2:]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert maps(files, out).identical(plain(out)) and stamps(out) == after


def test_files_that_were_copied_are_not_computed_again(files: Path, tmp_path: Path):
    """Other times of change and the same contents: nothing is written."""
    out = tmp_path / "s.zarr"
    maps(files, out)
    before = stamps(out)
    copied = tmp_path / "copied"
    shutil.copytree(files, copied)
    for file in copied.iterdir():
        os.utime(file, (1e9, 1e9))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        maps(copied, out)
    assert stamps(out) == before


def test_a_file_that_is_repaired_continues_the_store(files: Path, tmp_path: Path):
    """Set-up: file 3 is cut off, which ends the run; then it is whole again. Expected: the maps before it are kept."""
    out, bad = tmp_path / "s.zarr", files / "f3.npz"
    whole = bad.read_bytes()
    bad.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"f3\.npz"):
        maps(files, out)
    before = [(out / f"opd/c/{k}/0/0").stat().st_mtime_ns for k in range(3)]
    bad.write_bytes(whole)
    found = maps(files, out)
    assert stamps(out)[:3] == before and np.array_equal(found.opd, maps(files, None).opd, equal_nan=True)


def test_a_file_with_a_time_axis_that_is_written_again(tmp_path: Path):
    """NetCDF: all snapshots have the stamp of one file; those whose samples are the same are kept."""
    path, out = tmp_path / "flow.nc", tmp_path / "s.zarr"
    values = np.stack([samples(1, time) for time in TIMES[:COUNT]])
    where = {"time": TIMES[:COUNT], **dict(zip("xyz", AXES, strict=True))}

    def run(**options) -> xarray.Dataset:
        xarray.Dataset({"rho": (tuple(where), values)}, where, {"ambient_density": 1.2}).to_netcdf(path)
        return optical_series(flow.open_series(path), PUPIL, pixel_count=8, method="linear", **options)

    run(out=out)
    before = stamps(out)
    run(out=out)
    assert stamps(out) == before
    values[3] = samples(7, TIMES[3])
    with pytest.warns(UserWarning, match="files of snapshot 3 have changed"):
        found = run(out=out).load()
    assert stamps(out)[:3] == before[:3] and np.array_equal(found.opd, run().opd, equal_nan=True)


@pytest.mark.parametrize("first", [2, COUNT])
def test_a_series_that_has_grown_continues(first: int, files: Path, tmp_path: Path):
    """Set-up: a solver has written some files, and more after their maps were stored (finished or killed).

    Expected: the maps of all, equal to those of one run; those that were there are not written again, and the store
    has the times and the origin of all.
    """
    out, later = tmp_path / "s.zarr", tmp_path / "later"
    later.mkdir()
    for number in range(first, COUNT):
        (files / f"f{number}.npz").rename(later / f"f{number}.npz")
    write(files, first - 1, 1)
    maps(files, out)
    earlier = zarr.open_group(str(out)).attrs["definition"]
    before = [(out / f"opd/c/{k}/0/0").stat().st_mtime_ns for k in range(first)]
    for file in later.iterdir():
        file.rename(files / file.name)
    write(files, COUNT, 1) if first == COUNT else None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = maps(files, out).load()
        whole = maps(files, tmp_path / "whole.zarr").load()
    assert found.identical(whole) and plain(out).identical(whole)
    assert [(out / f"opd/c/{k}/0/0").stat().st_mtime_ns for k in range(first)] == before
    assert found.sizes["time"] == max(COUNT, first + (first == COUNT))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert maps(files, out).identical(whole)
        zarr.open_group(str(out)).attrs["definition"] = earlier  # as of a run that was killed after the arrays grew
        assert maps(files, out).identical(whole)


def test_what_differs_from_the_series_of_a_store_is_named(files: Path, tmp_path: Path):
    """Fewer files, files of other names, and a series that differs in what it has in common with the store."""
    maps(files, tmp_path / "s.zarr")
    (files / "f4.npz").rename(tmp_path / "f4.npz")
    with pytest.raises(ValueError, match="another series, of 5 files and not of 4"):
        maps(files, tmp_path / "s.zarr")
    shutil.copy(tmp_path / "f4.npz", files / "f5.npz")
    with pytest.raises(ValueError, match=r'whose files was "f4\.npz" and is "f5\.npz"'):
        maps(files, tmp_path / "s.zarr")
    write(files, 4, 7)
    with pytest.raises(ValueError, match="of 5 files and not of 6"):
        maps(files, tmp_path / "s.zarr")


@pytest.mark.parametrize("method", ["auto", "linear"])
def test_a_snapshot_that_was_never_written_is_refused(method: str):
    """Zeros, as a solver that was killed leaves them, have no slopes: their bending is never measured."""
    arrays = [samples(1, time) for time in TIMES[:COUNT]]
    arrays[2] = np.zeros(SHAPE)
    series = flow.open_series(
        arrays, time=TIMES[:COUNT], geometry="volume", origin=LOW, spacing=[SPACING] * 3, ambient_density=1.2
    )
    with pytest.raises(ValueError, match=r"snapshot 2: 1183 of 1183 densities on the grid are not positive"):
        optical_series(series, PUPIL, pixel_count=8, method=method)


def test_the_air_around_a_series_of_files_does_not_fluctuate(tmp_path: Path):
    """Set-up: a layer across the rays whose density changes in time, at the upstream end, and a tilted pupil.

    Expected: the same phase over the pupil, so no boresight. The ambient density followed the layer, which tilted the
    wavefront by K drho tan(angle) on lines of unequal length: 0.9 urad rms.
    """
    axes = [np.linspace(-0.1, 0.1, 11), np.linspace(-0.1, 0.1, 11), np.linspace(0.0, 0.2, 21)]
    for number, more in enumerate((0.0, 0.012, -0.012, 0.006)):
        density = np.full((11, 11, 21), 1.2)
        density[:, :, -3:] += more
        np.savez(tmp_path / f"f{number}.npz", rho=density, **dict(zip("xyz", axes, strict=True)))
    series = flow.open_series(tmp_path / "f*.npz", time_step=1e-5)
    assert [field.ambient_density for field in series] == [1.2] * 4
    pupil = Disc(0.03, center=(0.0, 0.0, 0.05), normal=(np.sin(0.5), 0.0, np.cos(0.5)))
    found = optical_series(series, pupil, direction=(0.0, 0.0, 1.0), pixel_count=16, method="linear")
    assert np.abs(found.boresight_x.values).max() < 1e-12 and np.ptp(found.piston.values) > 1e-8
    given = flow.open_series(tmp_path / "f*.npz", time_step=1e-5, ambient_density=1.1)
    assert {field.ambient_density for field in given} == {1.1}


def test_two_processes_do_not_write_one_series(tmp_path: Path):
    """One that writes holds the other off; one that begins with what it read before the first went on is refused."""
    from aerokernels.series.store import KEPT, MAPS, ZarrStore

    axis, path = np.linspace(-0.01, 0.01, 4), tmp_path / "maps.zarr"
    template = xarray.Dataset(coords={"time": np.arange(3.0), "y": axis, "x": axis})
    maps = {name: np.ones((4, 4), kind) for name, (kind, _, _) in MAPS.items()}
    numbers = dict.fromkeys(KEPT, 1.0)
    first, late = (ZarrStore(path, template, lambda count: {"series": "a"}) for _ in range(2))
    with first.writing():
        first.add(maps, numbers)
        with late.writing(), pytest.raises(ValueError, match="another process is at work there"):
            late.add(maps, numbers)
    with late.writing(), pytest.raises(ValueError, match="another process is at work there"):
        late.add(maps, numbers)
    again = ZarrStore(path, template, lambda count: {"series": "a"})
    assert again.count == 1
    with again.writing():
        again.add(maps, numbers)
    assert [one.name for one in tmp_path.iterdir()] == ["maps.zarr"]
