"""Export: what is in the store is in the file, whatever is being written meanwhile."""

import csv

import numpy as np
import pytest
import xarray

from aerokernels.hardware import export as module
from aerokernels.hardware.export import export
from aerokernels.hardware.frames import DamagedPiece, EchoFrame, decode, encode
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.store import EchoStore, StoreError
from aerokernels.jobs.recorded import recorded_echoes


def frame(sequence: int, sample_count: int = 5) -> EchoFrame:
    samples = np.arange(sample_count) - 7 * sequence
    return decode(encode(EchoFrame(sequence, 10**6 + sequence, 250, 0.01, 0.5, samples, flags=2))[:-1])


@pytest.fixture
def store(tmp_path):
    """Echoes 0 to 9 at mach=2 and 12 to 14 at mach=3 run=b (two numbers missing), one damaged piece."""
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("p", "frames", {"mach": "2"})
        for k in range(10):
            store.add(frame(k), 1_700_000_000_000_000_000 + k)
        store.add_damaged(DamagedPiece(b"\x01", "CRC: does not match"), 0)
        store.commit()
        store.begin_recording("p", "frames", {"mach": "3", "run": "b"})
        for k in range(12, 15):
            store.add(frame(k), 1_700_000_000_000_000_000 + k)
        store.commit()
        yield store


def test_netcdf_holds_every_echo(store: EchoStore, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "ECHOES_AT_ONCE", 4)  # several blocks, the last one not full
    assert export(store, tmp_path / "echoes.nc") == 13
    with xarray.open_dataset(tmp_path / "echoes.nc", engine="h5netcdf") as data:
        expected = [echo.frame.voltage for echo in store.echoes()]
        np.testing.assert_allclose(data["voltage"], expected, rtol=1e-6)
        assert data["voltage"].attrs["units"] == "V"
        np.testing.assert_allclose(data["time"], np.arange(5) * 250e-12, rtol=1e-12)
        assert data["sequence"].values.tolist() == [*range(10), 12, 13, 14]
        assert data["device_time_us"].values.tolist() == [10**6 + k for k in [*range(10), 12, 13, 14]]
        assert data["host_time"].values[3] == np.datetime64(1_700_000_000_000_000_003, "ns")
        assert data["label_mach"].values.tolist() == ["2"] * 10 + ["3"] * 3
        assert data["label_run"].values.tolist() == [""] * 10 + ["b"] * 3
        assert set(data["voltage"].coords) == {"time", "sequence", "host_time", "label_mach", "label_run"}
        assert (data.attrs["missing_count"], data.attrs["damaged_count"]) == (2, 1)


def test_csv_holds_every_echo(store: EchoStore, tmp_path):
    assert export(store, tmp_path / "echoes.csv", {"mach": "3"}) == 3
    with (tmp_path / "echoes.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row, echo in zip(rows, store.echoes({"mach": "3", "run": "b"}), strict=True):
        assert (int(row["sequence"]), row["label_mach"], row["label_run"]) == (echo.frame.sequence, "3", "b")
        volts = [float(row[f"voltage_{k}_v"]) for k in range(5)]
        np.testing.assert_allclose(volts, echo.frame.voltage, rtol=1e-6)
        assert float(row["sample_period_s"]) == 250e-12


def test_echoes_of_different_shapes(store: EchoStore, tmp_path):
    """A longer echo, an empty one and a curve with another time axis: padded, and no common axis is claimed."""
    store.begin_recording("q", "scpi", {})
    store.add(frame(20, 8), 0)
    store.add(frame(21, 0), 0)
    store.add(ScopeCurve(3, 400, 0.1, 0.0, np.array([1, 2], np.int16), -1e-9, "", b"#12\x01\x02"), 0)
    store.commit()
    export(store, tmp_path / "echoes.nc")
    with xarray.open_dataset(tmp_path / "echoes.nc", engine="h5netcdf") as data:
        assert "time" not in data.variables
        assert data["sample_count"].values.tolist() == [5] * 13 + [8, 0, 2]
        np.testing.assert_array_equal(np.isfinite(data["voltage"]).sum("sample"), data["sample_count"])
        np.testing.assert_allclose(data["sample_period"][-1], 400e-12)
        np.testing.assert_allclose(data["first_sample_time"][-1], -1e-9)
        np.testing.assert_allclose(data["voltage"][-1, :2], [0.1, 0.2], rtol=1e-6)
        assert data["device_time_us"].values[-1] == -1
    export(store, tmp_path / "echoes.csv")
    lines = (tmp_path / "echoes.csv").read_text(encoding="utf-8").splitlines()
    assert len({line.count(",") for line in lines}) == 1 and len(lines) == 17


@pytest.mark.parametrize(("offset", "kind"), [(0.0, "float32"), (1.0, "float32"), (100.0, "float64")])
def test_counts_survive_a_large_offset(tmp_path, offset: float, kind: str):
    """Counts of 1e-5 V on 100 V: single precision rounds to 0.76 counts there, and seven digits of a text to one."""
    counts = np.arange(-50, 50)
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("p", "frames", {})
        store.add(EchoFrame(0, 0, 250, 1e-5, offset, counts), 0)
        store.commit()
        (frame,) = (echo.frame for echo in store.echoes())
        for name in ("e.nc", "e.csv"):
            export(store, tmp_path / name)
            (back,) = recorded_echoes(tmp_path / name)
            np.testing.assert_allclose(back.voltage, frame.voltage, rtol=0.0, atol=frame.scale / 8.0)
    with xarray.open_dataset(tmp_path / "e.nc", engine="h5netcdf", decode_times=False) as data:
        assert data["voltage"].dtype == kind


def test_what_cannot_be_exported_is_refused_and_leaves_nothing(store: EchoStore, tmp_path):
    (tmp_path / "folder.nc").mkdir()
    before = sorted(tmp_path.iterdir())
    for out, label, match in (
        ("echoes.txt", {}, "ends in .nc or .csv"),
        ("no/echoes.nc", {}, "does not exist"),
        ("folder.nc", {}, "is a folder"),
        ("echoes.nc", {"mach": "9"}, "no echoes with label mach=9; it has: mach=2, mach=3 run=b"),
    ):
        with pytest.raises(ValueError, match=match):
            export(store, tmp_path / out, label)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("name", ["e.nc", "e.csv"])
def test_a_full_disk_leaves_nothing_half_written(tmp_path, name, full_disk):
    """Files that may have 100 kB only, and an export of several hundred."""
    path = tmp_path / "s.sqlite"
    random = np.random.default_rng(3)
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {})
        for k in range(100):
            samples = random.integers(-32768, 32768, 2000)
            store.add(decode(encode(EchoFrame(k, k, 1, 1.0, 0.0, samples))[:-1]), 0)
        store.commit()
    full_disk(100_000)
    with EchoStore(path, read_only=True) as store, pytest.raises(StoreError, match=f"{name}: .*make room"):
        export(store, tmp_path / name)
    assert not [one.name for one in tmp_path.iterdir() if "e." in one.name and "sqlite" not in one.name]


def test_the_command(store: EchoStore, tmp_path, command_line):
    done = command_line("export", store.path, "--out", tmp_path / "e.nc", "--label", "mach=2")
    assert done.returncode == 0 and "wrote 10 echoes" in done.stderr, done.stderr
    done = command_line("export", tmp_path / "absent.sqlite", "--out", tmp_path / "f.nc")
    assert done.returncode == 2 and "no such file" in done.stderr and len(done.stderr.splitlines()) == 1
