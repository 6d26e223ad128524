"""What every medium with exact rays is held to."""

import functools

import numpy as np

from aerokernels.tracing import TraceResult, trace

from .closed_forms import Case
from .media import CASES


@functools.cache
def case(name: str) -> Case:
    """One of CASES, built once."""
    return CASES[name]()


def worst_errors(case: Case, result: TraceResult) -> dict[str, float]:
    """The greatest error over the rays, by output, in units of a ray's length; every ray must have arrived."""
    assert result.ok.all(), result.status_summary()
    ends, path = case.ends, case.ends.arc_length
    opd = ends.opd(case.rays, case.field.ambient_index, case.until)
    off = {
        "position": np.linalg.norm(result.position - ends.position, axis=1),
        "direction": np.linalg.norm(result.direction - ends.direction, axis=1) * case.scale,
        "optical_path": np.abs(result.optical_path - ends.optical_path),
        "opd": np.abs(result.opd - opd),
        "arc_length": np.abs(result.arc_length - ends.arc_length),
    }
    return {name: float((error / path).max()) for name, error in off.items()}


def assert_float64(case: Case, allowed: float, **settings) -> None:
    """Float64 traces end within `allowed` of the path; the length, which no error control watches, within 1e-8."""
    off = worst_errors(case, trace(case.field, case.rays, until=case.until, precision="float64", **settings))
    assert off.pop("arc_length") < 1e-8
    assert max(off.values()) < allowed, off


def assert_float32(case: Case, **settings) -> dict[str, float]:
    """Float32 traces, at the default tolerance, are as near as rounding lets them; returns the errors.

    Optical path: a sample of the potential s adds up to 64 products, each rounded to 2^-24 of the greatest |s|; of
    random sign, that makes 8, and as much again for the rounded coefficients. The share of the path that the ambient
    index makes up is not rounded at all. Position and direction: the slope of s, a difference between coefficients
    over a cell, is rounded to 2^-24 |s| / h, by turns up and down; what is left of it after some cells is a few times
    2^-24 of the path, as is the rounding of the place at which s is looked up. 16 times is allowed.
    """
    off = worst_errors(case, trace(case.field, case.rays, until=case.until, precision="float32", **settings))
    contrast = case.field.samples.samples
    greatest = np.abs(contrast * (case.field.ambient_index + 0.5 * contrast)).max()
    assert max(off["position"], off["direction"]) < 16.0 * 2.0**-24, off
    assert max(off["optical_path"], off["opd"]) < 16.0 * 2.0**-24 * greatest, off
    return off
