"""A shock as a tanh step across a plane, from 8 cells thick to a twentieth of one, against Snell's law.

Errors are given in units of the shock: optical paths over jump times cell, directions over the turn. The thickness is
that from 10 to 90 % of the jump, 2.2 widths of the tanh. Rays cross the shock well inside the box, in float64 and with
steps to 1e-6 wave: 9e-13 m, which is 4e-6 of jump times cell.
"""

import functools
import math

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from tests.slow import first_of

from .layers import Step

CELL, JUMP = 1e-3, 2.4e-4
UNIT = JUMP * CELL
INTERPOLATIONS = ("cubic", "linear", "monotone")
STEPS = 4e-6 * 5  # in UNIT: the tolerance, and as much again for every budget of a step that a kink overdraws


@functools.cache
def errors(width, angle, ray_angle, interpolation, *, cell_averages, place=0.1, ray_count=16):
    """Errors of the optical path [UNIT] and of the direction [turns], each (ray_count,).

    Rays at `ray_angle` [degrees] to z, side by side over a few cells, through a shock of `width` cells whose normal is
    at `angle` [degrees] to z, `place` cells from the origin; the stop is a plane across the rays.
    """
    shock = Step(JUMP, width * CELL, math.radians(angle), place * CELL)
    side = 12 if ray_angle == 0 else 50
    y, z = CELL * np.arange(-side, side + 1), CELL * np.arange(-80, 81)
    field = shock.field(y, z, interpolation, cell_averages=cell_averages)
    slant = math.radians(ray_angle)
    along, across = (
        np.array([0.0, math.sin(slant), math.cos(slant)]),
        np.array([0.0, math.cos(slant), -math.sin(slant)]),
    )
    reach = 76.0 * CELL if ray_angle == 0 else 50.0 * CELL
    beside = 0.331 * CELL * (np.arange(ray_count) - 0.5 * ray_count + 0.37)
    rays = RayBundle(-reach * along + beside[:, None] * across, along[None])
    until = Plane(reach * along, along)
    incidence = math.radians(angle - ray_angle)
    past = min(18.0 * width * CELL, reach * math.cos(incidence) - 9.0 * CELL * abs(math.sin(incidence)))
    _, direction, path = shock.exact(rays, until, past)
    result = trace(field, rays, until=until, precision="float64", method="adaptive", tolerance=1e-6)
    assert result.ok.all()
    off = np.linalg.norm(result.direction - direction, axis=1)
    return (result.optical_path - path) / UNIT, off / (JUMP * max(abs(math.tan(incidence)), 1e-30))


@pytest.mark.parametrize("interpolation", first_of(INTERPOLATIONS))
@pytest.mark.parametrize("width", first_of([0.0225, 0.9, 3.6, 1.8, 0.45, 0.18], 2))
def test_cell_averages_keep_a_shock_across_the_axis(width, interpolation):
    """The same from cell averages: their sum is the integral, so nothing is left but steps, however thin the shock.

    Where the shock is thinner than half a cell that is at least 1000 times better than samples at the nodes. Rays
    stay straight: no direction error beyond rounding.
    """
    path, node = [], []
    for place in (-0.37, 0.1, 0.28):
        path.append(errors(width, 0, 0, interpolation, cell_averages=True, place=place, ray_count=4)[0])
        node.append(errors(width, 0, 0, interpolation, cell_averages=False, place=place, ray_count=4)[0])
    assert np.abs(path).max() < STEPS
    if width < 0.2:
        assert np.abs(node).max() > 1000.0 * np.abs(path).max()


@pytest.mark.parametrize("interpolation", first_of(["cubic", "linear"]))
@pytest.mark.parametrize("angle", [35.0, 60.0])
@pytest.mark.parametrize("width", first_of([0.0225, 0.9, 3.6, 1.8, 0.45, 0.18], 2))
def test_rays_along_a_grid_axis_through_an_oblique_shock(width, angle, interpolation):
    """Set-up: cell averages, shock at 35 and 60 degrees, rays along z.

    The integral along a line of the grid is kept as above, and so is that of the slope, the turn. What is left is of
    second order in the jump: a ray that is moved sideways by jump tan(angle) times a part of a cell: a tenth for the
    C2 cubic, a third for linear, whose slope jumps. Through the slope of the shock that changes path and turn by the
    same part times jump tan(angle)^2. Tolerance: that with the parts 0.3 and 1; steps.
    """
    path, turn = errors(width, angle, 0, interpolation, cell_averages=True)
    second = {"cubic": 0.3, "linear": 1.0}[interpolation] * JUMP * math.tan(math.radians(angle)) ** 2
    assert np.abs(path).max() < second + STEPS
    assert turn.max() < second + STEPS


@pytest.mark.parametrize(("angle", "ray_angle"), [(10.0, 30.0), (35.0, -20.0)])
@pytest.mark.parametrize(
    ("interpolation", "resolved", "two_cells"),
    [
        ("cubic", (5e-6, 2e-5), (4e-4, 2e-3)),
        ("linear", (1e-4, 1e-3), (2e-3, 0.015)),
        ("monotone", (3e-4, 3e-3), (5e-3, 0.04)),
    ],
)
def test_rays_at_an_angle_to_grid_and_shock(angle, ray_angle, interpolation, resolved, two_cells):
    """Set-up: cell averages, shocks 4 and 2 cells and a twentieth of a cell thick, rays along no axis of the grid.

    A line that is slanted to the grid sees waves of the shock folded by the grid, damped by x / sinh(x),
    x = pi k width / 2, with k down to about 4 per cell; the interpolant's order damps them again. So the error falls
    exponentially with thickness: path and turn to the limits given for 4 and 2 cells, twice what the fold makes. A
    shock thinner than a cell is off by up to a tenth of a cell in path, 0.6 from samples at nodes, and its turn by
    tens of per cent: on any grid a sharp shock is a staircase, and only thickness mends it.
    """
    steps = np.array([STEPS, 1e-5])
    for width, allowed in ((1.8, resolved), (0.9, two_cells), (0.0225, (0.1, 0.6))):
        path, turn = errors(width, angle, ray_angle, interpolation, cell_averages=True, ray_count=48)
        assert np.abs(path).max() < allowed[0] + steps[0] and turn.max() < allowed[1] + steps[1]
    path, _ = errors(0.0225, angle, ray_angle, interpolation, cell_averages=False, ray_count=48)
    assert 0.2 < np.abs(path).max() < 0.75


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_order_on_a_resolved_shock(interpolation):
    """Set-up: shock at 35 degrees 4 mm thick, node samples, rays at -20 degrees; cells of 1.33, 1 and 0.67 mm.

    The turn's error falls at least as fast as the interpolant's order: cubic 4, linear 2, monotone 2; a tanh, being
    analytic, gives more. Errors of the steps: 1e-6 of the turn, below all that is fitted.
    """
    cells = np.array([1.33, 1.0, 0.67])
    off = [
        np.sqrt(np.mean(errors(1.2 / cell, 35.0, -20.0, interpolation, cell_averages=False, ray_count=48)[1] ** 2))
        for cell in cells
    ]
    assert np.polyfit(np.log(cells), np.log(off), 1)[0] > {"cubic": 4.0, "linear": 2.0, "monotone": 2.0}[interpolation]


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_no_step_jumps_over_a_sheet_of_one_cell(interpolation):
    """Set-up: one row of nodes with contrast in 400 rows without, default tolerance, 400 rays from all places ahead.

    Expected: jump times cell, 0.27 wave, the sum of samples, for each interpolant; a step over the sheet would lose
    all of it. Tolerance: the one asked for, 1e-3 wave.
    """
    contrast = np.zeros((25, 401))
    contrast[:, 200] = JUMP
    field = IndexField.from_samples(
        contrast, origin=(-12.0 * CELL, 0.0), spacing=(CELL, CELL), geometry="planar", interpolation=interpolation
    )
    start = np.zeros((400, 3))
    start[:, 2] = np.random.default_rng(0).uniform(0.0, 50.0 * CELL, 400)
    until = Plane((0.0, 0.0, 400.0 * CELL), (0.0, 0.0, 1.0))
    result = trace(field, RayBundle(start, [[0.0, 0.0, 1.0]]), until=until, precision="float64", method="adaptive")
    assert result.ok.all()
    assert np.abs(result.opd - UNIT).max() < 1e-3 * 905e-9
