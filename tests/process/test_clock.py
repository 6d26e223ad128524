"""The one clock: stages interrupt each other, inner clocks run with outer ones, nothing is counted twice."""

import time

import numpy as np

from aerokernels import IndexField, RayBundle, trace
from aerokernels.process.clock import STAGES, clocked, stage


def test_a_stage_within_another_interrupts_it():
    """20 ms of "compile" within 10 ms and 10 ms of "plan": each has its own, and they add up to the total at most."""
    with clocked() as seconds:
        with stage("plan"):
            time.sleep(0.01)
            with stage("compile"):
                time.sleep(0.02)
            time.sleep(0.01)
    assert seconds["plan"] >= 0.02 and seconds["compile"] >= 0.02
    assert seconds["plan"] + seconds["compile"] <= seconds["total"]
    assert seconds["kernel"] == seconds["upload"] == seconds["download"] == 0.0


def test_an_outer_clock_has_what_inner_ones_have():
    with clocked() as outer:
        with clocked() as first, stage("kernel"):
            time.sleep(0.005)
        with clocked() as second, stage("kernel"):
            time.sleep(0.005)
    assert outer["kernel"] == first["kernel"] + second["kernel"]
    assert outer["total"] >= first["total"] + second["total"]


def test_a_trace_tells_its_stages_and_its_error_has_a_clock_of_its_own():
    """The stages of a call add up to its total at most; reading the error leaves the total as it was."""
    samples = 1e-5 * np.random.default_rng(0).random((9, 9))
    field = IndexField.from_samples(samples, origin=(-1e-3, 0.0), spacing=(2.5e-4,) * 2, geometry="planar")
    rays = RayBundle(np.c_[np.zeros((20, 2)), np.full(20, -1e-3)], (0.0, 0.1, 1.0))
    result = trace(field, rays)
    assert set(result.seconds) == set(STAGES) - {"error", "landing", "spread", "render"}
    total = result.seconds["total"]
    assert 0.0 < sum(result.seconds[name] for name in ("plan", "upload", "compile", "kernel", "download")) <= total
    assert result.error["total"] > 0.0
    assert result.seconds["error"] > 0.0 and result.seconds["total"] == total
