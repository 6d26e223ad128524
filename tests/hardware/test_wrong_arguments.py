"""Arguments that the Python interface of the recorder cannot use: a sentence at once, and nothing reaches the file."""

import math
from pathlib import Path

import numpy as np
import pytest

from aerokernels.compare import compare_waveforms
from aerokernels.hardware.export import export
from aerokernels.hardware.frames import DamagedPiece, EchoFrame
from aerokernels.hardware.port import open_port
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.recorder import Recorder
from aerokernels.hardware.simulator import EchoSource, PseudoTerminal
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.comparison import CompareOptions, compare_recording
from aerokernels.jobs.recorded import recorded_labels

FRAME = {
    "sequence": 1, "device_time_us": 2, "sample_period_ps": 250, "scale": 1e-3, "offset": 0.0, "samples": np.arange(20)
}  # fmt: skip
CURVE = {
    "sequence": 1, "sample_period_ps": 250, "scale": 1e-3, "offset": 0.0, "samples": np.arange(20),
    "first_sample_time": 0.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("label", "match"),
    [({"mach": 3}, "3 in {'mach': 3} is none"), (["mach=3"], "got"), (None, "got None"), ({"a": "\udcff"}, "is none")],
)
def test_a_label_that_could_not_be_read_back_is_refused(tmp_path: Path, label, match: str):
    """A number in a label was stored, and every later reading ended with "a row is not that of an echo"."""
    with EchoStore(tmp_path / "s.sqlite") as store:
        with pytest.raises(TypeError, match=match):
            store.begin_recording("p", "frames", label)
        with pytest.raises(TypeError, match=match if label is not None else "got"):
            list(store.echoes(label if label is not None else 5))
        store.begin_recording("p", "frames", {"mach": "3"})
        store.add(EchoFrame(**FRAME), 0)
        store.commit()
        assert store.labels() == [{"mach": "3"}]


def test_echoes_that_no_recording_has_are_refused(tmp_path: Path):
    with EchoStore(tmp_path / "s.sqlite") as store:
        for add, what in ((store.add, EchoFrame(**FRAME)), (store.add_damaged, DamagedPiece(b"\1", "CRC"))):
            with pytest.raises(ValueError, match="call begin_recording"):
                add(what, 0)
        store.begin_recording("p", "frames", {})
        for add, what in ((store.add, b"\1"), (store.add_damaged, "CRC")):
            with pytest.raises(TypeError, match=r"EchoFrame|DamagedPiece"):
                add(what, 0)
        with pytest.raises(TypeError, match="host_time_ns must be a whole number, got 'now'"):
            store.add(EchoFrame(**FRAME), "now")
        assert store.add(EchoFrame(**FRAME), np.int64(5))
        store.commit()
    with pytest.raises(ValueError, match=r"s\.sqlite: it is closed; open it again"):
        store.labels()
    with (
        EchoStore(tmp_path / "s.sqlite", read_only=True) as store,
        pytest.raises(ValueError, match="for reading only; open it without"),
    ):
        store.begin_recording("p", "frames", {})


@pytest.mark.parametrize("kind", [EchoFrame, ScopeCurve])
@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("scale", math.nan, "scale must be finite, got nan"),
        ("offset", "0", "offset must be one number, got '0'"),
        ("scale", None, "scale must be one number, got None"),
        ("sequence", 1.5, "sequence must be a whole number, got 1.5"),
        ("samples", np.arange(20) * 0.5, "float64 do not fit int16"),
        ("samples", np.arange(20) * 2000, "int64 do not fit int16"),
        ("samples", 7, "one row"),
    ],
)
def test_echoes_check_themselves(kind: type, name: str, value, match: str):
    """A curve with a scale that is no number was dropped at its commit without a word; its counts wrapped at 2**15."""
    with pytest.raises((ValueError, TypeError), match=match):
        kind(**((FRAME if kind is EchoFrame else CURVE) | {name: value}))


@pytest.mark.parametrize(
    ("made", "match"),
    [
        (lambda folder: export("s.sqlite", folder / "e.nc"), "store must be an EchoStore that is open"),
        (lambda folder: export(EchoStore(folder / "s.sqlite"), None), "out must be a text or a Path"),
        (lambda folder: export(EchoStore(folder / "s.sqlite"), folder / "e.nc", "mach=3"), "a label is texts"),
        (lambda folder: Recorder(None, None, None, count=1.5), "count must be a whole number"),
        (lambda folder: Recorder(None, None, None, batch_size=0), "batch_size must be a whole number"),
        (lambda folder: Recorder(None, None, None, stall_time="1"), "stall time = '1' s: give 0 or more"),
        (lambda folder: open_port(5), "port must be a text such as /dev/ttyUSB0, got 5"),
        (lambda folder: open_port("/dev/x", baud="fast"), "the line rate must be a whole number"),
        (lambda folder: open_port("/dev/x", timeout=math.nan), "timeout = nan: give seconds"),
        (lambda folder: open_port("/dev/x", flow=None), "flow control None: give one of none"),
        (lambda folder: EchoSource(["a"]), "the echo must hold real numbers"),
        (lambda folder: EchoSource([1.0], sample_period_ps=0), "sample_period_ps must be a whole number"),
        (lambda folder: EchoSource([1.0], noise="a"), "noise must be one number"),
        (lambda folder: PseudoTerminal(None), "link must be a text or a Path"),
        (lambda folder: recorded_labels(None), "path must be a text or a Path"),
        (lambda folder: compare_recording(folder / "s.sqlite", []), "runs must be a list of runs, as read_run returns"),
        (lambda folder: CompareOptions(align=None), "align must be none, each, or a label"),
        (lambda folder: CompareOptions(threshold="1 V"), "threshold must be"),
        (lambda folder: CompareOptions(trigger_offset="1 ns"), "trigger_offset must be a time in seconds"),
        (lambda folder: CompareOptions(ranged_count=2.5), "ranged_count must be a whole number of at least 2"),
        (lambda folder: CompareOptions(seed=-1), "seed must be a whole number of at least 0"),
    ],
)
def test_each_wrong_argument_gets_a_sentence(tmp_path: Path, made, match: str):
    """Before, most ended in an AttributeError, a message of NumPy's about casts, or an error much later."""
    with pytest.raises((ValueError, TypeError), match=match):
        made(tmp_path)


@pytest.mark.parametrize(
    ("recorded", "simulated", "match"),
    [
        (np.full(50, np.nan), None, "the recorded waveform: voltage: 50 of 50 values are not finite"),
        (None, np.ones(50), "the simulated waveform is constant"),
        (1e308, None, "the recorded waveform peaks at 1e.308 V, which is out of all proportion"),
        (None, 1e-308, "the simulated waveform peaks at 1e-308 V"),
    ],
)
def test_a_message_names_the_waveform_that_is_wrong(recorded, simulated, match: str):
    """The error was "voltage: ..." or "the first waveform", and for 1e308 V "All-NaN slice encountered"."""
    time = np.arange(50) * 1e-9
    pulse = np.exp(-(((time - 25e-9) / 5e-9) ** 2))
    given = [pulse if one is None else one * pulse if np.isscalar(one) else one for one in (recorded, simulated)]
    with pytest.raises(ValueError, match=match):
        compare_waveforms(time, *given)
