"""What recorders, simulated instruments and stores refuse, and faults that interrupt a line."""

import math

import numpy as np
import pytest

from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.preamble import Preamble, PreambleError
from aerokernels.hardware.recorder import Recorder
from aerokernels.hardware.simulator import FaultPlan, PseudoTerminal, SimulatedScope, run_board

from .line import needs_pseudo_terminals

SOURCE = EchoSource.gaussian(noise=0.0)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: SimulatedScope(SOURCE, rate=0.0), "acquisitions per second: give a positive one"),
        (lambda: run_board(None, SOURCE, rate=-1.0), "echoes per second: give a positive one"),
        (lambda: FaultPlan({}, pause=-1.0), r"pause = -1\.0 s: give 0 or more"),
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


@needs_pseudo_terminals
def test_a_plug_that_is_pulled_and_put_back(tmp_path):
    """Expected: the link is gone while the plug is out, and leads to a terminal again when it is in."""
    link = tmp_path / "port"
    plan, seen = FaultPlan({}, pause=0.02), []
    with PseudoTerminal(link) as terminal:
        plan.interrupt("gap", terminal, lambda: pytest.fail("a gap does not wait"))
        plan.interrupt("stall", terminal, lambda: seen.append(link.exists()))
        plan.interrupt("unplug", terminal, lambda: seen.append(link.exists()))
        assert link.exists() and True in seen and False in seen
    with pytest.raises(ValueError, match=r"folder .* does not exist"):
        PseudoTerminal(tmp_path / "none" / "port")
