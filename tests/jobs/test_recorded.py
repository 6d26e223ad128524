"""Files of recorded echoes: each kind gives the same numbers; what is damaged, or of unknown units, is refused."""

from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels.hardware.export import export
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.recorded import recorded_echoes, recorded_labels

from .echoes_on_file import LABELS, TIME, WRITERS, noisy, pulse


@pytest.mark.parametrize("name", WRITERS)
def test_every_kind_of_file_gives_the_same_echoes(tmp_path: Path, name: str):
    """Stores hold counts of 0.1 mV, half of which is the tolerance; the others hold float64 in full."""
    echoes = noisy(3, 0.02)
    path = WRITERS[name](tmp_path / name, echoes)
    assert recorded_labels(path) == list(LABELS.values())
    back = list(recorded_echoes(path))
    assert [echo.label for echo in back] == [echo.label for echo in echoes]
    for one, other in zip(back, echoes, strict=True):
        np.testing.assert_allclose(one.time, other.time, atol=1e-20)
        np.testing.assert_allclose(one.voltage, other.voltage, atol=5.1e-5)
    assert len(list(recorded_echoes(path, LABELS[3]))) == 3


def test_labels_that_look_like_formulas_survive_an_export(tmp_path: Path):
    """`export` marks "-5 deg" as a text for spreadsheets; read back it is the label again."""
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("p", "frames", {"tilt": "-5 deg", "note": "'quoted'"})
        store.add(EchoFrame(0, 0, 250, 1e-4, 0.0, np.arange(32)), 0)
        store.commit()
        export(store, tmp_path / "echoes.csv")
    assert "'-5 deg" in (tmp_path / "echoes.csv").read_text()
    assert recorded_labels(tmp_path / "echoes.csv") == recorded_labels(tmp_path / "s.sqlite")


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("absent.csv", None, "no such file"),
        ("empty.csv", "", "first line"),
        ("head.csv", "a,b\n1,2\n", "time_s"),
        ("words.csv", "time_s,mach=0\n0,zero\n", "line 2: 'zero'"),
        ("ragged.csv", "time_s,mach=0\n0,1,2\n", "line 2 has 3 values"),
        ("short.csv", "time_s,mach=0\n0,1\n1,2\n", "at least 16"),
        ("back.csv", "time_s,mach=0\n" + "".join(f"{-k},1\n" for k in range(20)), "do not increase"),
        ("nan.csv", "time_s,mach=0\n" + "".join(f"{k},nan\n" for k in range(20)), "not finite"),
        ("none.csv", "sequence,sample_period_s,voltage_0_v\n", "no echoes"),
        ("bytes.csv", b"\xff\xfe\x00\x01", "neither a store"),
        ("broken.nc", b"\x89HDF\r\n\x1a\n" + b"\x00" * 100, "NetCDF"),
        ("broken.sqlite", b"SQLite format 3\x00" + b"\x00" * 100, "store"),
    ],
)
def test_bad_recordings_are_refused_by_name(tmp_path: Path, name: str, content, match: str):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match=match) as refused:
        [list(recorded_echoes(path, label)) for label in recorded_labels(path)]
    assert name in str(refused.value)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # h5netcdf, of a file it half opened
@pytest.mark.parametrize("name", WRITERS)
def test_damaged_recordings_are_read_or_refused_by_name(tmp_path: Path, name: str):
    """Bytes changed and ends cut off, 60 times: echoes, or a ValueError that names the file; nothing else."""
    whole = WRITERS[name](tmp_path / name, noisy(3, 0.02)).read_bytes()
    path, random, refused = tmp_path / f"bad-{name}", np.random.default_rng(3), 0
    for number in range(60):
        damaged = bytearray(whole[: random.integers(20, len(whole)) if number % 3 == 0 else None])
        for _ in range(random.integers(1, 6)):
            damaged[random.integers(min(len(damaged), 3000))] = random.integers(256)
        path.write_bytes(damaged)
        try:
            for label in recorded_labels(path):
                list(recorded_echoes(path, label))
        except ValueError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 10


@pytest.mark.parametrize(("head", "unit"), [("time_ns", 1e-9), ("time [us]", 1e-6), ("Time (s)", 1.0), ("time", 1.0)])
def test_a_unit_in_the_head_of_the_times_is_heeded(tmp_path: Path, head: str, unit: float):
    path = tmp_path / "e.csv"
    path.write_text(f"{head},mach=0\n" + "\n".join(f"{at / unit!r},1.0" for at in TIME.tolist()))
    (echo,) = recorded_echoes(path)
    assert echo.time == pytest.approx(TIME, rel=1e-12)
    path.write_text(path.read_text().replace(head, "time_cubits"))
    with pytest.raises(ValueError, match="time_cubits"):
        list(recorded_echoes(path))


def test_units_of_a_netcdf_file_are_heeded(tmp_path: Path):
    path = tmp_path / "e.nc"
    rows = xarray.Dataset({"voltage": ("time", 1e3 * pulse(TIME), {"units": "mV"})}, {"time": ("time", 1e9 * TIME)})
    rows["time"].attrs["units"] = "ns"
    rows.to_netcdf(path, engine="h5netcdf")
    (echo,) = recorded_echoes(path)
    assert echo.time == pytest.approx(TIME, abs=1e-18) and echo.voltage == pytest.approx(pulse(TIME), rel=1e-12)
    rows["voltage"].attrs["units"] = "counts"
    rows.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(ValueError, match=r"e\.nc: the units of `voltage`: '1 counts'"):
        list(recorded_echoes(path))
