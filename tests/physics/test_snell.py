"""A step of the index between two rows of nodes: Snell's law and total reflection, which no grid can resolve.

The momentum along the layer is kept by every interpolant that does not depend on the place along it, so the direction
far behind is Snell's however the step is spread; place and path are those of a step somewhere within its cell.
"""

import functools
import math

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

from .layers import Step

THIN, LONG = 1e-4, 1e-3  # cells across the layer and along it [m]
NORMALS = {"z": np.array([0.0, 0.0, 1.0]), "y": np.array([0.0, 1.0, 0.0])}
INTERPOLATIONS = ("cubic", "linear", "monotone")


def steps_off(interpolation: str, before: float, behind: float, least_momentum: float) -> float:
    """Direction error that steps make.

    Within cells all are smooth, and steps to 1e-6 wave leave 1e-9. At the faces of cells the slope of linear jumps and
    that of monotone has a corner, and steps are not cut below 1e-4 of a cell: off by that part of the change of
    momentum across the layer, or about ten times its square.
    """
    change = 0.5 * abs(behind**2 - before**2)
    return {"linear": 1e-4 * change / least_momentum, "monotone": 2e-9 + 1e-7 * change, "cubic": 2e-9}[interpolation]


@functools.cache
def step_field(before, behind, axis, interpolation, cells=None, count=40) -> IndexField:
    """Index `before` on the nodes up to 0 along `axis`, `behind` on those from 1 on; cells are thin along it."""
    cells = cells or ((LONG, THIN) if axis == "z" else (THIN, LONG))
    row = np.where(np.arange(-count, count + 1) >= 1, behind - before, 0.0)
    contrast = np.repeat(row[None], 2 * count + 1, axis=0)
    return IndexField.from_samples(
        contrast if axis == "z" else contrast.T,
        origin=(-count * cells[0], -count * cells[1]),
        spacing=cells,
        geometry="planar",
        ambient_index=before,
        interpolation=interpolation,
    )


def incident(degrees, axis: str, depth: float):
    """Rays at angles to the layer's normal, a third of their slant along x, that meet the layer near the origin."""
    angle = np.radians(degrees)
    aside = np.array([0.3, 0.0, 0.0]) + math.sqrt(0.91) * NORMALS["y" if axis == "z" else "z"]
    direction = np.sin(angle)[:, None] * aside + np.cos(angle)[:, None] * NORMALS[axis]
    return RayBundle(-depth / np.cos(angle)[:, None] * direction, direction)


def refracted(rays: RayBundle, normal, before: float, behind: float) -> np.ndarray:
    """Snell's law: directions behind a step."""
    across = rays.direction @ normal
    along = before / behind * (rays.direction - across[:, None] * normal)
    return along + np.sqrt(1.0 - np.sum(along**2, axis=1))[:, None] * normal


@pytest.mark.usefixtures("both_backends")
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("axis", ["z", "y"])
@pytest.mark.parametrize(
    ("before", "behind", "degrees"),
    [
        (1.0, 1.5, (0, 20, 45, 65)),
        (1.5, 1.0, (0, 20, 35, 38)),
        (1.0003, 1.0, (0, 30, 60, 85)),
        (1.0, 1.0003, (0, 40, 80, 88)),
    ],
)
def test_snell(before, behind, degrees, axis, interpolation):
    """Set-up: the step on the axis y or z, rays from 30 cells ahead to 30 behind, where a spline's ringing is 1e-17.

    Formula: n sin(angle) is kept; rays run along x as well. Errors: steps only. Tolerance: steps_off.
    """
    rays = incident(np.array(degrees), axis, 30.0 * THIN)
    field = step_field(before, behind, axis, interpolation)
    until = Plane(30.0 * THIN * NORMALS[axis], NORMALS[axis])
    result = trace(field, rays, until=until, precision="float64", method="adaptive", tolerance=1e-6)
    assert result.ok.all()
    exact = refracted(rays, NORMALS[axis], before, behind)
    least = np.minimum(before * rays.direction @ NORMALS[axis], behind * exact @ NORMALS[axis])
    off = np.linalg.norm(result.direction - exact, axis=1)
    assert (off < steps_off(interpolation, before, behind, least)).all()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_snell_at_the_default_tolerance(precision):
    """The same under "monotone" and 1e-3 wave, both precisions: direction within 1e-6, 16 roundings of float32."""
    for before, behind in ((1.0, 1.5), (1.5, 1.0), (1.0003, 1.0)):
        rays = incident(np.array([5.0, 25.0, 38.0]), "z", 30.0 * THIN)
        field = step_field(before, behind, "z", "monotone")
        until = Plane(30.0 * THIN * NORMALS["z"], NORMALS["z"])
        result = trace(field, rays, until=until, precision=precision, method="adaptive")
        assert result.ok.all()
        assert np.abs(result.direction - refracted(rays, NORMALS["z"], before, behind)).max() < 1e-6


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_place_and_path_go_with_the_cell(interpolation):
    """Set-up: a sharp step from 1 to 1.5 at z = 0 as averages over cells of 1, 1/2, 1/4 mm; rays of 20 to 60 degrees.

    Formula: Snell's law for the step itself. Errors: the ray bends within the two cells that the step is spread over,
    so place and path are off by a part of a cell, below a half. All is similar: fitted order 1 +- 0.05, of which 0.004
    is the ringing of the cubic at the coarsest grid's stop.
    """
    cells, place, path = np.array([1e-3, 5e-4, 2.5e-4]), [], []
    step, until = Step(0.5, 0.0), Plane((0.0, 0.0, 9e-3), (0.0, 0.0, 1.0))
    rays = incident(np.array([20.0, 45.0, 60.0]), "z", 8e-3)
    position, _, exact = step.exact(rays, until, 1e-5)
    for cell in cells:
        nodes = cell * np.arange(-40, 41)
        field = step.field(nodes, nodes, interpolation)
        result = trace(field, rays, until=until, precision="float64", method="adaptive", tolerance=1e-6)
        assert result.ok.all()
        place.append(np.linalg.norm(result.position - position, axis=1))
        path.append(np.abs(result.optical_path - exact))
    for off in (np.array(place), np.array(path)):
        assert (off < 0.5 * cells[:, None]).all()
        assert np.abs(np.polyfit(np.log(cells), np.log(off), 1)[0] - 1.0).max() < 0.05


def bounce(field: IndexField, rays: RayBundle):
    """Each ray traced until it is as far behind the point of reflection as it started ahead of it.

    Some hundred steps do. Traced again for a kink's error that no step brings below the tolerance, a ray could take
    1e8; what 1e6 steps do not bring is not waited for.
    """
    settings = {"precision": "float64", "method": "adaptive", "tolerance": 1e-6, "max_steps": 1_000_000}
    for ray in range(rays.ray_count):
        start, direction = rays.position[ray], rays.direction[ray]
        until = Plane((0.0, -start[1], 0.0), (0.0, 1.0, 0.0))
        single = RayBundle(start[None], direction[None])
        yield single, trace(field, single, until=until, **settings)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize(("before", "behind"), [(1.5, 1.0), (1.0003, 1.0)])
def test_total_reflection(before, behind, interpolation):
    """Set-up: rays toward the thinner side, at 99 % of the greatest grazing angle that is reflected, down to 1 % of it.

    In air that is 0.0245 to 0.000245 rad. Expected: the ray turns back and arrives; angle of reflection = angle of
    incidence. Tolerance: steps_off; a ray that turns has no least momentum, so the one it comes with.
    """
    greatest = 0.5 * math.pi - math.asin(behind / before)
    graze = greatest * np.array([0.99, 0.9, 0.5, 0.1, 0.01])
    field = step_field(before, behind, "z", interpolation, (1.0, THIN))
    for rays, result in bounce(field, incident(90.0 - np.degrees(graze), "z", 30.0 * THIN)):
        assert result.ok[0]
        off = np.abs(result.direction - rays.direction * [1.0, 1.0, -1.0]).max()
        assert off < steps_off(interpolation, before, behind, before * rays.direction[0, 2])


@pytest.mark.parametrize("interpolation", ["linear", "monotone"])
def test_a_ray_above_the_critical_angle_passes(interpolation):
    """At 101 % of the greatest grazing angle that is reflected the ray passes, refracted to Snell's direction.

    Tolerance: just beyond the critical angle the direction behind goes with the root of what is left over.
    """
    greatest = math.acos(1.0 / 1.5)
    rays = incident(np.degrees([0.5 * math.pi - 1.01 * greatest]), "z", 30.0 * THIN)
    until = Plane((0.0, 0.0, 30.0 * THIN), (0.0, 0.0, 1.0))
    field = step_field(1.5, 1.0, "z", interpolation)
    result = trace(field, rays, until=until, precision="float64", method="adaptive", tolerance=1e-6)
    exact = refracted(rays, NORMALS["z"], 1.5, 1.0)
    assert result.ok.all()
    off = np.abs(result.direction - exact).max()
    assert off < steps_off(interpolation, 1.5, 1.0, exact[0, 2])
