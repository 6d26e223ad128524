"""The table of step bounds, and that no ray is blind to what lies between two samples."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.step_bound import CONES, step_bound
from tests.slow import first_of

WAVE = 905e-9
CELL = 1e-4
FORWARD = CONES[1 + 4 * 2]  # about +z, the narrow one


def planar(contrast, interpolation: str = "cubic") -> IndexField:
    """A field on square cells, y about 0, z from 0."""
    low = -0.5 * CELL * (contrast.shape[0] - 1)
    return IndexField.from_samples(
        contrast, origin=(low, 0.0), spacing=(CELL, CELL), geometry="planar", interpolation=interpolation
    )


def layer(slope: float, place: float, shape=(65, 257), width: float = 0.5) -> np.ndarray:
    """A tanh layer `width` cells thick that crosses the axis at cell `place`, aslant by `slope`."""
    y, z = np.meshgrid(np.arange(shape[0]) - 0.5 * (shape[0] - 1), np.arange(shape[1]), indexing="ij")
    return 1.2e-4 * (1.0 + np.tanh((z - place - slope * y) / (width * np.hypot(1.0, slope))))


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_the_table_never_reaches_over_a_shock(slope):
    """From each block the reach along z ends before the layer begins, 8 thicknesses from its middle at the most.

    (The layer of 1.2e-4 over half a cell: its fourth differences fall below the rounding of the samples there.)
    """
    field = planar(layer(slope, 150.0))
    table = step_bound(field.samples, "planar", 1e-3 * WAVE, FORWARD)
    half = 0.5 * 64
    for row in range(table.length.shape[0]):
        # The layer's place at the row's two edges; the cone opens by its spread on the way.
        y = np.array([row * table.block, (row + 1) * table.block]) - half
        first = np.min(150.0 + slope * y)
        for column in range(table.length.shape[1]):
            z = column * table.block
            if z + table.block < first - 10:
                opened = (first - z) * np.tan(FORWARD.spread) * slope
                assert table.length[row, column] <= (first - z + 8 * 0.5 + opened) * CELL
    assert table.length[0, -1] > 20 * CELL  # behind it the way is free


@pytest.mark.parametrize("interpolation", first_of(["cubic", "linear", "monotone"]))
def test_a_spike_at_one_node_is_never_jumped_over(interpolation):
    """Set-up: a box of 257 cells, empty but for one node at any place; rays through it and beside it.

    Expected: the line integral through the interpolant, by sampling it 64 times a cell. Errors: second order, 1/2 int
    theta^2 with theta up to 2e-4 over 26 mm, 6e-10 m. Tolerance: that and twice the 1e-4 wave asked for; the spike,
    seen or not, is 2e-2 wave.
    """
    rng = np.random.default_rng(11)
    for _ in range(12):
        contrast = np.zeros((17, 257))
        contrast[8, rng.integers(20, 240)] = 0.02 * WAVE / CELL
        field = planar(contrast, interpolation)
        start = np.c_[np.zeros(9), CELL * rng.uniform(-1.2, 1.2, 9), np.zeros(9)]
        rays = RayBundle(start, [[0.0, 0.0, 1.0]])
        along = CELL * 256 * (np.arange(256 * 64) + 0.5) / (256 * 64)
        points = start[:, None] + along[None, :, None] * [0.0, 0.0, 1.0]
        expected = field.contrast_at(points.reshape(-1, 3)).reshape(9, -1).mean(axis=1) * CELL * 256
        result = trace(
            field,
            rays,
            until=Plane((0, 0, CELL * 256), (0, 0, 1)),
            method="adaptive",
            precision="float64",
            tolerance=1e-4,
        )
        assert np.abs(result.opd - expected).max() < 2e-4 * WAVE + 6e-10


def test_adaptive_needs_a_third_of_the_best_fixed_step_on_a_thin_shock():
    """Evaluations for 1e-4, 1e-5 and 1e-6 wave rms, an oblique layer a cell or so thick in 384 cells.

    Both curves of error against evaluations are measured; that of fixed steps takes its running minimum.
    """
    field = planar(layer(0.7, 190.0, (129, 385), 1.1))
    rng = np.random.default_rng(5)
    rays = RayBundle(np.c_[np.zeros(64), rng.uniform(-3e-3, 3e-3, 64), np.zeros(64)], [[0.0, 0.0, 1.0]])
    settings = {"until": Plane((0.0, 0.0, 38.4e-3), (0.0, 0.0, 1.0)), "precision": "float64"}
    exact = trace(field, rays, method="adaptive", tolerance=1e-8, **settings)

    def curve(options):
        rows = []
        for option in options:
            result = trace(field, rays, **option, **settings)
            error = np.sqrt(np.mean((result.opd - exact.opd) ** 2)) / WAVE
            rows.append((result.evaluation_count.mean(), error))
        return np.array(sorted(rows))

    fixed = curve([{"method": "fixed", "step": CELL * s} for s in (12, 8, 6, 4, 3, 2, 1.5, 1, 0.75)])
    adaptive = curve([{"method": "adaptive", "tolerance": t} for t in 10.0 ** np.arange(0.5, -5.0, -0.5)])

    def evaluations(rows, error):
        best = np.minimum.accumulate(np.log(rows[:, 1]))
        return np.exp(np.interp(-np.log(error), -best, np.log(rows[:, 0])))

    for error in (1e-4, 1e-5, 1e-6):
        assert evaluations(fixed, error) > 3.0 * evaluations(adaptive, error)
