"""What others wrote: sizes are held against the memory before anything is read; drawn inputs are taken or refused.

The corpus are draws that failed once, by kind and seed; scripts/fuzz_inputs draws a million.
"""

import os
import random
import warnings
from pathlib import Path

import numpy as np
import pytest

from aerokernels.flow import open_series, read
from aerokernels.hardware import export as exporting
from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.inputs.units import in_brackets, written_unit
from aerokernels.jobs.recorded import load_netcdf, recorded_labels
from aerokernels.jobs.store import read_result
from aerokernels.process import foreign_files, fragile
from aerokernels.scene import Scene, SceneError
from aerokernels.schlieren.picture_file import read_picture
from tests.draws import file_draws
from tests.draws.parser_draws import DRAWS

CORPUS = {"scene": (8380,), "override": (1018, 5030), "preamble": (1780,), "netcdf": (50,),
          "store": (9, 13, 18, 21, 30, 41, 61, 40010600, 50170604), "sweep": (41,), "row": (109, 149),
          "foam-file": (60012063, 60018110), "foam-case": (70064536, 70768724), "tecplot-text": (4585,),
          "plot3d": (1130,), "npz": (6, 48, 70984352, 80265532), "names": (60265237,),
          "unit": (7465,), "index": (1697,),
          "netcdf-result": (189, 301540), "netcdf-wavefront": (113, 365, 150469590),
          "netcdf-index": (703, 871, 200030, 150049255),
          "netcdf-series": (300225, 300401, 130000012), "cgns-nodes": (3688, 5164),
          "vtk-grids": (152, 1181, 2448)}  # fmt: skip


@pytest.mark.parametrize("kind", DRAWS)
def test_drawn_inputs_are_taken_or_refused_in_one_line(kind: str, tmp_path: Path):
    """The draws look at what comes out; some of each kind must be taken, or nothing but the first check is tested."""
    taken = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in (*CORPUS.get(kind, ()), *range(10_000, 10_040)):
            taken += DRAWS[kind](random.Random(seed), tmp_path)
    assert taken


def test_a_file_on_which_hdf5_computes_for_ever_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Draw 441: a damaged byte in the heap of an attribute, for whose end HDF5 looks for ever; here for a second."""
    for child in (idle := fragile._idle()):
        child.end()
    idle.clear()  # its bound counts from what it has computed: a new one is ended soonest
    bounds = fragile.bounds_of(Path(__file__))
    monkeypatch.setattr(fragile, "bounds_of", lambda path: bounds._replace(computing=0.0))
    monkeypatch.setattr(file_draws, "_read_all", lambda path: False)
    file_draws.netcdf(random.Random(441), tmp_path)
    with pytest.raises(
        ValueError, match=r"echoes\.nc: the library that reads it ended with signal \d+: .* write it again"
    ):
        recorded_labels(tmp_path / "echoes.nc")


@pytest.mark.parametrize(
    "reader", [load_netcdf, recorded_labels, read_result, read, open_series, EchoSource.from_result]
)
def test_every_reader_of_netcdf_survives_the_end_of_its_library(reader, tmp_path: Path, monkeypatch):
    """Set-up: HDF5 ends its process. Expected: the caller learns which file, and what to do."""

    class Ending:
        is_late = False

        def ask(self, request, time_limit):
            raise EOFError

        def end(self):
            return -11

    monkeypatch.setattr(fragile, "_idle", list)
    monkeypatch.setattr(fragile, "_Child", Ending)
    (tmp_path / "flow.nc").write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ValueError, match=r"flow\.nc: the library .* signal 11: the file is damaged .*: write it again"):
        reader(tmp_path / "flow.nc")


def test_what_happens_in_the_child_is_told_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Answers, errors of their own class, exits; a child that has gone is replaced.

    An interrupt ends one, and so does a file that it keeps open, which HDF5 would leave locked.
    """
    path = tmp_path / "a.nc"
    path.write_bytes(b"0")
    idle: list = []
    monkeypatch.setattr(fragile, "_idle", lambda: idle)
    assert fragile.in_child(path, "math:sqrt", 4.0) == 2.0 and len(idle) == 1
    with pytest.raises(foreign_files.NoRoomError, match="it announces"):
        fragile.in_child(path, "aerokernels.process.foreign_files:check_room", 1e30, "it")
    with pytest.raises(fragile.LibraryEndedError, match=r"a\.nc: the library that reads it ended with status 3: "):
        fragile.in_child(path, "os:_exit", 3)
    assert not idle and fragile.in_child(path, "os:getpid") == idle[0].process.pid
    (child,) = idle
    assert fragile.in_child(path, "os:open", path, os.O_RDONLY) > 2 and not idle and child.process.poll() is not None
    assert fragile.in_child(path, "os:getpid") == idle[0].process.pid != child.process.pid
    idle[0].process.kill()
    idle[0].process.wait()
    assert fragile.in_child(path, "os:getpid") == idle[0].process.pid
    (child,) = idle

    def interrupted(request, time_limit):
        raise KeyboardInterrupt

    monkeypatch.setattr(child, "ask", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fragile.in_child(path, "os:getpid")
    assert not idle and child.process.poll() is not None


def test_a_reader_that_waits_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Set-up: 0.5 s for a file, of which one sleeps for minutes."""
    path = tmp_path / "a.nc"
    path.write_bytes(b"0")
    fragile.in_child(path, "os:getpid")  # starts the child
    monkeypatch.setattr(fragile, "bounds_of", lambda path: fragile.Bounds(float("inf"), 100.0, 0.5))
    with pytest.raises(fragile.LibraryEndedError, match=r"a\.nc: it was not read within .* busy, or the"):
        fragile.in_child(path, "time:sleep", 300.0)


def test_large_arrays_of_a_netcdf_file_are_read_when_they_are_asked_for(tmp_path: Path):
    """Set-up: 20,000 numbers, packed, and texts, as xarray writes them. Expected: as xarray reads them; parts alike.

    A file that is gone by then is reported by its name, with the variable's.
    """
    import xarray

    from aerokernels.files.netcdf_reading import open_netcdf

    path = tmp_path / "series.nc"
    data = xarray.Dataset({"rho": (("time", "x"), np.arange(20_000.0).reshape(2, -1), {"units": "kg/m3"}),
                           "name": ("time", np.array(["a", "é"], object)), "good": ("time", [True, False])},
                          {"time": [0.0, 1.0]}, {"note": "as written"})  # fmt: skip
    data.to_netcdf(path, engine="h5netcdf", encoding={"rho": {"dtype": "i4", "scale_factor": 0.5, "_FillValue": -1}})
    found = open_netcdf(path, "it")
    assert found["good"].dtype == bool and found["rho"].isel(time=1, x=slice(2, 9, 3)).values.tolist() == [
        10_002.0, 10_005.0, 10_008.0]  # fmt: skip
    xarray.testing.assert_identical(found.load(), data)
    late = open_netcdf(path, "it")
    path.write_bytes(b"gone")
    with pytest.raises(ValueError, match=r"series\.nc: it has changed since it was opened: open it again"):
        late["rho"].load()


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
        with pytest.raises(ValueError, match=rf"{path.name}.* announces 562\.9 TB and there is memory for"):
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
    monkeypatch.setattr(foreign_files, "free_memory", lambda: 8000.0)
    with pytest.raises(ValueError, match=r"a snapshot announces 8\.19 kB and there is memory for 4 kB"):
        series.density(0)
    with pytest.raises(ValueError, match=r"picture .*bench\.png: .* announces 9\.6 kB"):
        read_picture(path, pixel_size=1e-4, nose=(1, 1))


def test_one_long_curve_does_not_make_long_rows_of_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Rows are as long as the longest echo: at 100 samples at a time and 40 an echo, two echoes go together."""
    monkeypatch.setattr(exporting, "SAMPLES_AT_ONCE", 100)
    sizes, blocks = [], exporting._blocks

    def counted(*arguments):
        for block in blocks(*arguments):
            sizes.append(len(block))
            yield block

    monkeypatch.setattr(exporting, "_blocks", counted)
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a = " + "[" * 100_000, "tables and lists are nested too deeply"),
        (".".join(["a"] * 2000) + " = 1", "tables and lists are nested too deeply"),  # no message could show it
        ("['a'." + ". ".join(['"a"'] * 100_000) + "]", "tables and lists are nested too deeply"),  # hours for tomllib
        ("a = " + "{a = " * 150 + "1" + "}" * 150, "tables and lists are nested too deeply"),
        ("a = " + "9" * 5000, "not valid TOML"),
        ("a = [0x" + "f" * 5000 + "]", "not valid TOML"),  # TOML, but Python does not show it
    ],
    ids=["brackets", "names", "many names", "tables", "digits", "hexadecimal digits"],
)
def test_a_scene_that_cannot_be_shown_is_refused(tmp_path: Path, text: str, told: str):
    path = tmp_path / "deep.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=rf"deep\.toml: {told}"):
        Scene.load(path)


def test_overrides_that_cannot_be_shown_are_refused():
    with pytest.raises(SceneError, match="a key of 3000 parts"):
        Scene.load("wind-tunnel-mach3", {".".join(["a"] * 3000): 1})
    with pytest.raises(SceneError, match=r"flow\.density = '0xfff"):
        Scene.load("wind-tunnel-mach3", {"flow.density": "0x" + "f" * 5000})


def test_small_flow_files_that_announce_much_are_refused_before_it_is_made(tmp_path: Path, monkeypatch):
    """Repeated numbers, axes without samples, and compressed files: kilobytes that would be gigabytes in memory."""
    import gzip

    path = tmp_path / "a.dat"
    path.write_text("VARIABLES = X Y rho\nZONE I=100000, J=100000, F=BLOCK\n30000000000*1.0\n")
    with pytest.raises(ValueError, match=r"a\.dat: zone 1 repeats 1 numbers until they are 30000000000: .*write it"):
        read(path)
    path.write_text("VARIABLES = X Y rho\nZONE " + "a " * 6000 + "\n0 0 1\n")
    with pytest.raises(ValueError, match=r"a\.dat: the head of zone 1 has \d+ letters"):
        read(path)
    axis = np.arange(5000.0)
    np.savez(tmp_path / "a.npz", x=axis, y=axis, z=axis, rho=np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"a\.npz: no array has a sample for each of the \(5000, 5000, 5000\) places"):
        read(tmp_path / "a.npz")
    np.savez_compressed(tmp_path / "b.npz", x=axis, y=axis, rho=np.ones(5000))
    (mesh := tmp_path / "case/constant/polyMesh").mkdir(parents=True)
    (time := tmp_path / "case/1").mkdir()
    (time / "rho").touch()
    (mesh / "points.gz").write_bytes(gzip.compress(b"FoamFile { } " + b" " * 50_000))
    monkeypatch.setattr(foreign_files, "free_memory", lambda: 80_000.0)
    with pytest.raises(ValueError, match=r"b\.npz: it announces 120 kB and there is memory for 40 kB"):
        read(tmp_path / "b.npz")
    with pytest.raises(ValueError, match=r"points\.gz: what it unpacks to announces 50 kB and there is memory for 40"):
        read(tmp_path / "case")


def test_long_names_of_units_take_no_time(tmp_path: Path):
    """A name of 300,000 brackets was looked through for minutes, and one of many powers was no number any more."""
    assert in_brackets("(" * 300_000) == "" and in_brackets("x (axial) [mm]") == "mm"
    assert written_unit("GPa^9 " * 30 + "m") is None and written_unit("m " * 10**6) is None
    assert written_unit("m^12345678901") is None and written_unit("kg m^-3") is not None


def test_names_of_a_file_do_not_fill_a_message(tmp_path: Path):
    """Set-up: 40 arrays of names of 60,000 letters, none of which is what is wanted. Expected: their beginnings."""
    import h5py

    names = [f"{'n' * 60_000}{k}" for k in range(40)]
    with h5py.File(tmp_path / "a.nc", "w") as file:
        (x := file.create_dataset("x", data=np.arange(3.0))).make_scale("x")
        for name in names:
            file.create_dataset(name, data=np.ones(3)).dims[0].attach_scale(x)
    np.savez(tmp_path / "a.npz", **{name: np.ones(3) for name in names})
    for reader, path in ((open_series, "a.nc"), (recorded_labels, "a.nc"), (read, "a.nc"), (read, "a.npz")):
        with pytest.raises(ValueError, match=r"n{50,60}\.\.\., .* and \d\d more") as refused:
            reader(tmp_path / path)
        assert len(str(refused.value)) < 3000


def test_a_compressed_file_that_unpacks_to_no_field_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Set-up: 20 kB that unpack to 8 MB, and bounds of 2 MB and 200 bytes a byte. Expected: refused, not held."""
    import gzip

    from aerokernels.flow.reading.readers import foam_file

    (mesh := tmp_path / "case/constant/polyMesh").mkdir(parents=True)
    (time := tmp_path / "case/1").mkdir()
    (time / "rho").touch()
    packed = gzip.compress(b"FoamFile { } " + b" " * 8_000_000)
    (mesh / "points.gz").write_bytes(packed)
    monkeypatch.setattr(foam_file, "UNPACKED", 2_000_000)
    monkeypatch.setattr(foam_file, "PIECE", 100_000)
    with pytest.raises(ValueError, match=rf"points\.gz: its {len(packed)} bytes unpack to more than .* gunzip"):
        read(tmp_path / "case")


def test_an_archive_of_many_arrays_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Set-up: 300 members. Expected: none is looked for among the names of all, which takes the square of the time."""
    import zipfile

    axis = np.arange(3.0)
    np.savez(tmp_path / "a.npz", x=axis, y=np.arange(4.0), rho=np.ones((3, 4)), **{f"a{k}": axis for k in range(300)})
    asked = []
    monkeypatch.setattr(zipfile.ZipFile, "namelist", lambda self: asked.append(self) or list(self.NameToInfo))
    assert read(tmp_path / "a.npz").density.max() == 1.0 and len(asked) < 3
