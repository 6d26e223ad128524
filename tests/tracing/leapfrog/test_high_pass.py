"""What a high pass leaves of a field: what samples do not resolve, and no more beside faces that rays run along."""

import numpy as np
import pytest
from scipy.interpolate import NdBSpline, make_interp_spline

from aerokernels.medium.grid import UniformGrid
from aerokernels.tracing.step_bound import potential_at_nodes
from aerokernels.tracing.tasks import unresolved
from aerokernels.tracing.tasks.high_pass import high_pass

# Share of the change in a cell, for air that is linear across the rays; values even about the faces leave 0.22.
LINEAR = 0.025


def faded(count: int, width: float) -> np.ndarray:
    """1 in the middle of an axis, 0 at both ends, twice differentiable."""
    share = np.clip(np.minimum(np.arange(count), count - 1 - np.arange(count)) / width, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def spline_through(values: np.ndarray) -> NdBSpline:
    """The cubic spline through nodes one apart, not-a-knot, by SciPy."""
    knots = []
    for axis, count in enumerate(values.shape):
        along = make_interp_spline(np.arange(count), values, 3, axis=axis)
        knots.append(along.t)
        values = np.moveaxis(along.c, 0, axis)
    return NdBSpline(tuple(knots), values, 3)


@pytest.mark.parametrize("seed", range(4))
def test_samples_resolve_what_is_not_passed(seed: int):
    """Slanted lines through air that is cut at the side faces: the rule errs by what is passed, within 2 %."""
    shape, cells, steep = (20, 24, 120), 119.0 / 20.0, np.array([0.15, 0.1, 1.0])
    random = np.random.default_rng(seed)
    frequencies = np.meshgrid(*[np.fft.fftfreq(2 * count) for count in shape], indexing="ij")
    size = np.maximum(np.sqrt(sum(axis**2 for axis in frequencies)), 1e-2) ** -3.0
    made = np.fft.ifftn(np.fft.fftn(random.normal(size=size.shape)) * size).real[:20, :24, :120]
    made *= 1e-5 / np.abs(made).max() * faded(120, 40.0)
    grid = UniformGrid(made, np.zeros(3), np.ones(3), "cubic", False, 1.0003)
    passed = high_pass(grid, steep, cells, 0.92, True)
    direction = np.c_[random.uniform(-1.0, 1.0, (400, 2)) * steep[:2], np.ones(400)]
    start = np.c_[random.uniform(0.0, 1.0, (400, 2)) * [19.0, 23.0], np.zeros(400)]
    end = start + 119.0 * direction
    stays = ((end[:, :2] >= 0.0) & (end[:, :2] <= [19.0, 23.0])).all(axis=1)
    start, direction = start[stays], direction[stays]

    def error_of_rule(values: np.ndarray) -> np.ndarray:
        spline, sums = spline_through(values), []
        for count in (20, 960):
            along = (np.arange(count) + 0.5) / count * 119.0
            sums.append(spline(start[:, None] + along[None, :, None] * direction[:, None]).mean(axis=1))
        return np.asarray(sums[0] - sums[1])

    potential = potential_at_nodes(grid)
    error, rest = error_of_rule(potential), error_of_rule(potential - passed)
    assert len(start) > 80
    assert np.abs(rest).max() <= 0.02 * np.abs(error).max()


@pytest.mark.parametrize("steep", [(0.3, 0.2, 1.0), (0.1, 0.3, 1.0)])
def test_a_slope_at_a_side_face_is_no_structure(steep: tuple[float, float, float]):
    """Air that changes linearly across the rays, and slowly along them, has nothing that samples miss."""
    x, y = np.arange(16)[:, None, None], np.arange(20)[:, None]
    made = 1e-6 * (x - 0.5 * y) * faded(160, 70.0)
    grid = UniformGrid(made, np.zeros(3), np.ones(3), "cubic", False, 1.0003)
    passed = high_pass(grid, np.array(steep), 6.5, 0.92, True)
    slope = max(unresolved._slopes(passed, axis, (slice(None),) * 3).max() for axis in (0, 1))
    assert np.abs(passed).max() <= LINEAR * 1e-6
    assert slope <= LINEAR * 1e-6
