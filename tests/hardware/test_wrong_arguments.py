"""Arguments that the Python interface of the recorder cannot use: a sentence at once, and nothing reaches the file."""

import math
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.decoder import DamagedPiece
from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.store import EchoStore

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
        ("scale", math.nan, "scale = nan"),
        ("offset", "0", "offset must be a number, got '0'"),
        ("scale", None, "scale must be a number, got None"),
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


def test_a_scale_that_float32_rounds_to_zero_is_refused():
    with pytest.raises(ValueError, match="scale = 1e-50 is beyond float32"):
        EchoFrame(**(FRAME | {"scale": 1e-50}))
