"""What others wrote: sizes are held against the memory before anything is read; drawn inputs are taken or refused.

The corpus are draws that failed once, by kind and seed.
"""

import os
import random
import warnings
from pathlib import Path

import numpy as np
import pytest

from aerokernels.flow import open_series, read
from aerokernels.hardware.simulator import EchoSource
from aerokernels.jobs.recorded import recorded_labels
from aerokernels.jobs.store import read_result
from aerokernels.process import fragile
from aerokernels.scene import Scene, SceneError
from tests.draws import file_draws
from tests.draws.parser_draws import DRAWS

CORPUS = {"scene": (8380,), "override": (1018, 5030), "preamble": (1780,), "netcdf": (50,), "sweep": (41,),
          "store": (9, 13, 18, 21, 30, 41, 61, 40010600, 50170604)}  # fmt: skip


@pytest.mark.parametrize("kind", DRAWS)
def test_drawn_inputs_are_taken_or_refused_in_one_line(kind: str, tmp_path: Path):
    """The draws look at what comes out; some of each kind must be taken, or nothing but the first check is tested."""
    taken = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seeds = range(10_000, 10_040)
        if kind == "netcdf" and "AEROKERNELS_SLOW" not in os.environ:
            seeds = seeds[14:18]  # each that HDF5 refuses takes a second
        for seed in (*CORPUS.get(kind, ()), *seeds):
            taken += DRAWS[kind](random.Random(seed), tmp_path)
    assert taken


def test_a_file_on_which_hdf5_computes_for_ever_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Draw 441: a damaged byte in the heap of an attribute, for whose end HDF5 looks for ever; here for a second."""
    for child in (idle := fragile._idle()):
        child.end()
    idle.clear()  # its bound counts from what it has computed: a new one is ended soonest
    monkeypatch.setattr(fragile, "LEAST_COMPUTING", 0.0)
    monkeypatch.setattr(file_draws, "_read_all", lambda path: False)
    file_draws.netcdf(random.Random(441), tmp_path)
    with pytest.raises(
        ValueError, match=r"echoes\.nc: the library that reads it ended with signal \d+: .* write it again"
    ):
        recorded_labels(tmp_path / "echoes.nc")


@pytest.mark.parametrize("reader", [recorded_labels, read_result, read, open_series, EchoSource.from_result])
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


def test_a_small_file_that_announces_terabytes_is_refused_before_it_is_read(tmp_path: Path, readers_here):
    """Each reader of NetCDF; HDF5 gives such a file as zeros, so that a system without this check is out of memory."""
    for reader in (recorded_labels, read):
        path = announcing(tmp_path / f"{reader.__name__}.nc", "voltage")
        with pytest.raises(ValueError, match=rf"{path.name}.* announces 562\.9 TB and there is memory for"):
            reader(path)
    with pytest.raises(ValueError, match=r"series\.nc: its list of coordinates announces 281\.5 TB"):
        open_series(announcing(tmp_path / "series.nc", "density", "time"), ambient_density=1.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a = " + "[" * 100_000, "tables and lists are nested too deeply"),
        (".".join(["a"] * 2000) + " = 1", "tables and lists are nested too deeply"),  # no message could show it
        ("['a'." + ". ".join(['"a"'] * 5_000) + "]", "tables and lists are nested too deeply"),  # hours for tomllib
        ("a = " + "9" * 5000, "not valid TOML"),
        ("a = [0x" + "f" * 5000 + "]", "not valid TOML"),  # TOML, but Python does not show it
    ],
    ids=["brackets", "names", "many names", "digits", "hexadecimal digits"],
)
def test_a_scene_that_cannot_be_shown_is_refused(tmp_path: Path, text: str, told: str):
    path = tmp_path / "deep.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=rf"deep\.toml: {told}"):
        Scene.load(path)
