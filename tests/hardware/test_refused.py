"""What recorders and simulated instruments refuse."""

import math

import numpy as np
import pytest

from aerokernels.hardware.preamble import Preamble, PreambleError
from aerokernels.hardware.recorder import Recorder
from aerokernels.hardware.simulator import EchoSource, SimulatedScope, run_board

SOURCE = EchoSource(np.ones(8), noise=0.0)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: SimulatedScope(SOURCE, rate=0.0), "acquisitions per second: give a positive one"),
        (lambda: run_board(None, SOURCE, rate=-1.0), "echoes per second: give a positive one"),
        (lambda: EchoSource(np.ones((2, 2))), r"an echo of shape \(2, 2\): give one row"),
        (lambda: EchoSource(np.array([1.0, math.nan])), "the echo: 1 of 2 values are not finite"),
        (lambda: EchoSource(np.ones(3), noise=-1.0), "noise must be"),
        (lambda: Recorder(None, None, None, count=0), "count = 0: give 1 or more"),
        (lambda: Recorder(None, None, None, commit_interval=float("nan")), r"commit interval = nan s: give 0 or more"),
        (lambda: Recorder(None, None, None, stall_time=-1.0), r"stall time = -1\.0 s: give 0 or more"),
    ],
)
def test_numbers_that_no_instrument_has(made, told):
    with pytest.raises(ValueError, match=told):
        made()


@pytest.mark.parametrize(
    ("name", "value"),
    [("offset", math.nan), ("scale", 1e305), ("sample_period", 1e300), ("first_sample_time", math.inf)],
)
def test_preambles_out_of_range(name, value):
    sound = {"sample_count": 3, "sample_period": 1e-9, "first_sample_time": 0.0, "scale": 0.01, "offset": 0.0}
    kinds = {field: sound.get(field) for field in Preamble.__dataclass_fields__}
    with pytest.raises(PreambleError, match=r"preamble: (offset|first_sample_time) = |is out of range"):
        Preamble(**{**kinds, name: value})
