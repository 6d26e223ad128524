"""Files of recorded echoes: each kind gives the same numbers; what is damaged, or of unknown units, is refused."""

from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels.hardware.export import export
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.recorded import recorded_echoes, recorded_labels

from .echoes_on_file import LABELS, PERIOD, TIME, WRITERS, noisy, pulse


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


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda head, cells: (head, [*cells[:20], "", *cells[21:]]), r"line 4: voltage_19_v is empty and later"),
        (lambda head, cells: ([*head[:20], *head[21:]], [*cells[:20], *cells[21:]]), "has no column voltage_19_v"),
        (lambda head, cells: ([*head, "voltage_3_v"], [*cells, "1"]), "has voltage_3_v twice"),
        (lambda head, cells: (head, [*cells, "1"]), "line 4 has 202 values, the first line 201 columns"),
        (lambda head, cells: (head, cells[:150]), "line 4 has 150 values, the first line 201 columns"),
    ],
)
def test_samples_that_are_missing_do_not_move_the_others(tmp_path: Path, change, match: str):
    """An empty cell in the middle, a lost column, one given twice, a row that is too long, and one that is cut off."""
    head = ["sample_period_s", *(f"voltage_{k}_v" for k in range(TIME.size))]
    head, cells = change(head, [repr(PERIOD), *map(repr, pulse(TIME).tolist())])
    (tmp_path / "e.csv").write_text(f"# comment\n\n{','.join(head)}\n{','.join(cells)}\n")
    with pytest.raises(ValueError, match=match):
        list(recorded_echoes(tmp_path / "e.csv"))


@pytest.mark.parametrize("times", ["time", "sample_period"])
def test_a_netcdf_file_may_have_its_samples_first(tmp_path: Path, times: str):
    """50 echoes of 200 samples over (sample, echo) are not 200 echoes of 50 samples."""
    volts = np.stack([pulse(TIME, 1.0 + 0.01 * number) for number in range(50)])
    axis = {"time": ("sample", TIME)} if times == "time" else {"sample_period": PERIOD}
    xarray.Dataset({"voltage": (("sample", "echo"), volts.T), **axis}).to_netcdf(tmp_path / "e.nc", engine="h5netcdf")
    echoes = list(recorded_echoes(tmp_path / "e.nc"))
    np.testing.assert_array_equal([echo.voltage for echo in echoes], volts)
    assert all(echo.time == pytest.approx(TIME, abs=1e-20) for echo in echoes)
