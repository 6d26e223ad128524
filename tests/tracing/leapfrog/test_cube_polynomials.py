"""Leapfrog samples of polynomials of cubes of cells, where the tolerance allows it, instead of the spline."""

import numpy as np
import pytest

from aerokernels import IndexField, Plane, RayBundle, trace
from aerokernels.medium.spline import weights
from aerokernels.tracing.scheme import CUBE_SIDE
from aerokernels.tracing.tasks.cube_polynomials import OFTEN, POWERS, WHOLE, cube_polynomials
from scripts.studies.bundles import bundle_scene

from ..backends import WAVE

H = 1e-4
SHAPE = (18, 17, 24)  # odd and even numbers of cells
TOLERANCE = 1e-3
STOP = Plane((0.0, 0.0, (SHAPE[2] - 1) * H), (0.0, 0.0, 1.0))


def field(wide: float, noise: float = 0.0, needle: float = 0.0) -> IndexField:
    """A blob `wide` cells wide of contrast 6e-4, with noise of cell scale, and a needle of two cells' width."""
    x, y, z = np.meshgrid(*(np.arange(count) - 0.5 * (count - 1) for count in SHAPE), indexing="ij")
    made = 6e-4 * np.exp(-(x**2 + y**2 + (0.5 * z) ** 2) / wide**2)
    made += noise * np.random.default_rng(2).normal(size=SHAPE)
    made += needle * np.exp(-((x - 3.0) ** 2 + (y - 2.0) ** 2) / 1.0)
    return IndexField.from_samples(made, origin=(0.0, 0.0, 0.0), spacing=(H,) * 3, geometry="volume", wavelength=WAVE)


def rays(count: int = 4096) -> RayBundle:
    """Incoherent ones, from the face z = 0, that stay in the box."""
    rng = np.random.default_rng(3)
    start = np.c_[rng.uniform(4.0 * H, 12.0 * H, (count, 2)), np.zeros(count)]
    return RayBundle(start, np.c_[rng.normal(0.0, 0.02, (count, 2)), np.ones(count)])


def numbers(table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of rows of a table: the polynomials' numbers, and the bounds of value and slope."""
    bits = np.ascontiguousarray(table[:, WHOLE:]).view(np.uint32)
    halves = np.stack([bits << np.uint32(16), bits & np.uint32(0xFFFF0000)], axis=-1).reshape(len(table), -1)
    found = halves.view(np.float32)
    return np.concatenate([table[:, :WHOLE], found[:, :-2]], axis=1), found[:, -2], found[:, -1]


def test_polynomials_are_as_far_off_the_spline_as_they_say():
    """At 2000 places value within its bound, slopes within that over OFTEN; the last cubes have cells of their own."""
    grid = field(4.0).samples
    place = np.random.default_rng(1).uniform(0.0, 1.0, (2000, 3)) * (np.array(SHAPE) - 1)
    place[:300, 0] = SHAPE[0] - 1 - 0.5 * place[:300, 0] / SHAPE[0]  # in the last cell along x, whose cube has one
    cell = np.minimum(place.astype(int), np.array(SHAPE) - 2)
    parts = [weights("cubic", place[:, axis] - cell[:, axis]) for axis in range(3)]
    windows = np.lib.stride_tricks.sliding_window_view(grid.coefficients, (4, 4, 4))[tuple(cell.T)]
    spline = [
        np.einsum("nabc,an,bn,cn->n", windows, *(part[int(axis == slope)] for axis, part in enumerate(parts)))
        for slope in (None, 0, 1, 2)
    ]
    cube = (place // CUBE_SIDE).astype(int)
    u = 2.0 * (place / CUBE_SIDE - cube) - 1.0
    made, value, slope = numbers(cube_polynomials(grid)[tuple(cube.T)])
    powers = np.array(POWERS)
    terms = u[:, None, :] ** powers
    assert (np.abs((made * terms.prod(axis=2)).sum(axis=1) - spline[0]) <= value + 1e-11).all()
    assert value.max() < 0.01 * np.abs(spline[0]).max()
    for axis in range(3):
        along = powers[:, axis] * u[:, None, axis] ** np.maximum(powers[:, axis] - 1, 0)
        others = np.delete(terms, axis, axis=2).prod(axis=2)
        off = np.abs((made * along * others).sum(axis=1) * 2.0 / CUBE_SIDE - spline[1 + axis]) / H
        assert (off <= 1.02 * slope / OFTEN + 1e-6).all()


def traced(made: IndexField, backend: str, **options):
    pytest.importorskip({"opencl": "pyopencl"}.get(backend, backend))
    options = {"tolerance": TOLERANCE, "wavelength": WAVE, "outputs": ("opd", "direction", "step_error"), **options}
    return trace(made, rays(), until=STOP, backend=backend, bundle="off", **options)


def test_a_smooth_field_is_looked_up_in_cubes_and_both_engines_agree():
    """OPD within a quarter of the tolerance of 1e-3 wave, and within each ray's estimate (error control in float64)."""
    made = field(20.0)
    found = [traced(made, backend) for backend in ("opencl", "warp")]
    exact = traced(made, "opencl", method="adaptive", precision="float64", tolerance=1e-5)
    for result in found:
        assert result.plan.cubes and "cubic polynomial of 2 x 2 x 2 cells" in str(result.plan)
        error = np.abs(result.opd - exact.opd)
        assert error.max() < 0.25 * TOLERANCE * WAVE and (error <= result.step_error).all()
        assert np.linalg.norm(result.direction - exact.direction, axis=1).max() < 1e-6
    assert np.abs(found[0].opd - found[1].opd).max() < 1e-5 * WAVE


def test_noise_of_cells_and_fine_tolerances_take_the_spline():
    assert not traced(field(20.0, noise=2e-5), "opencl").plan.cubes
    assert not traced(field(20.0), "opencl", tolerance=1e-7).plan.cubes
    assert not traced(field(20.0), "opencl", precision="float64").plan.cubes


def test_a_needle_is_not_missed():
    """Two cells wide, through a twentieth of the bundle: every ray within the tolerance, whatever is looked up."""
    made = field(20.0, needle=4e-4)
    exact = traced(made, "opencl", method="adaptive", precision="float64", tolerance=1e-5)
    assert np.abs(traced(made, "opencl").opd - exact.opd).max() < TOLERANCE * WAVE


@pytest.mark.slow
def test_a_few_more_samples_are_tried_where_bounds_add_up_to_too_much(monkeypatch):
    """Slanted rays of the cone scene: with the fewest samples one ray in twenty is just above its limit."""
    pytest.importorskip("pyopencl")
    scene = bundle_scene("slanted")
    some = scene.make_rays(130_000, 1)
    options = {"until": scene.until, "wavelength": WAVE, "bundle": "off", "backend": "opencl", "outputs": ("opd",)}
    found = trace(scene.make_field(), some, **options)
    assert found.plan.cubes and found.ok.all()
    monkeypatch.setattr("aerokernels.tracing.leapfrog.sample_count.CUBES_TRIALS", 1)
    before = trace(scene.make_field(), some, **options).plan
    assert not before.cubes and before.sample_count < found.plan.sample_count
    few = slice(0, 400)
    exact = trace(scene.make_field(), some[few], **{**options, "method": "adaptive", "precision": "float64"})
    assert np.abs(found.opd[few] - exact.opd).max() < 0.1 * TOLERANCE * WAVE
