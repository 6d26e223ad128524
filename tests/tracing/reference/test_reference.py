"""The reference engine against what it shares no line with: SciPy's splines under another integrator, and exact rays.

The other integrator takes z as its parameter: with the momentum p across it and w = sqrt(n^2 - p^2),

    dx/dz = p / w,   dp/dz = grad s / w,   d(optical path)/dz = n^2 / w,

by the classic Runge-Kutta rule in equal shares of every cell, extrapolated to none. Where a ray crosses the nodes of
its other axes a cubic spline's third derivative jumps: what that leaves is of the same order, and of random size.
"""

import numpy as np
import pytest
from scipy.interpolate import NdBSpline, RectBivariateSpline, make_interp_spline

from aerokernels.medium import Body, IndexField, QuadMesh
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, trace
from tests.random_fields import noise
from tests.slow import first_of

WAVE = 905e-9
AMBIENT = 1.0003
CELL = 1e-4
UP = (0.0, 0.0, 1.0)


def by_reference(field, rays, **settings):
    return trace(field, rays, backend="reference", precision="float64", **settings)


def potential_of(contrast):
    return contrast * (AMBIENT + 0.5 * contrast)


def field_of(geometry: str, contrast) -> IndexField:
    origin = {"volume": (-5e-4, -5e-4, 0.0), "planar": (-1.2e-3, 0.0), "axisymmetric": (0.0, 0.0)}[geometry]
    return IndexField.from_samples(
        contrast, origin=origin, spacing=(CELL,) * len(origin), geometry=geometry, ambient_index=AMBIENT
    )


def scipy_potential(geometry: str, contrast):
    """(x, y, z) -> s and its slopes along x and y, by splines of SciPy through the same samples."""
    s = potential_of(contrast)
    axes = [CELL * np.arange(n) for n in s.shape]
    if geometry == "volume":
        coefficients, knots = s, []
        for axis, nodes in enumerate(axes):
            spline = make_interp_spline(nodes, coefficients, axis=axis)
            knots.append(spline.t)
            coefficients = np.moveaxis(spline.c, 0, axis)
        whole = NdBSpline(tuple(knots), coefficients, 3)

        def in_volume(x, y, z):
            at = np.stack([x + 5e-4, y + 5e-4, np.full_like(x, z)], axis=1)
            return whole(at), whole(at, nu=(1, 0, 0)), whole(at, nu=(0, 1, 0))

        return in_volume
    if geometry == "planar":
        flat = RectBivariateSpline(axes[0] - 1.2e-3, axes[1], s, s=0)

        def in_plane(x, y, z):
            at = np.full_like(x, z)
            return flat.ev(y, at), np.zeros_like(x), flat.ev(y, at, dx=1)

        return in_plane
    # Mirrored at the axis, so that it is even.
    both = np.concatenate([-axes[0][:0:-1], axes[0]])
    round_ = RectBivariateSpline(both, axes[1], np.concatenate([s[:0:-1], s]), s=0)

    def about_axis(x, y, z):
        at, radius = np.full_like(x, z), np.hypot(x, y)
        slope = round_.ev(radius, at, dx=1) / np.where(radius > 0.0, radius, 1.0)
        return round_.ev(radius, at), slope * x, slope * y

    return about_axis


def by_z(look, rays, layers: int, parts: int):
    """Positions, momenta across z and OPD [m] of rays from z = 0 to the face at layers * CELL."""
    obliquity = AMBIENT / rays.direction[:, 2]

    def slope(z, state):
        s, along_x, along_y = look(state[:, 0], state[:, 1], z)
        square = AMBIENT**2 + 2.0 * s
        w = np.sqrt(square - state[:, 2] ** 2 - state[:, 3] ** 2)
        return np.stack([state[:, 2] / w, state[:, 3] / w, along_x / w, along_y / w, square / w - obliquity], axis=1)

    start = look(rays.position[:, 0], rays.position[:, 1], 0.0)[0]
    index = np.sqrt(AMBIENT**2 + 2.0 * start)
    state = np.concatenate(
        [rays.position[:, :2], index[:, None] * rays.direction[:, :2], np.zeros((rays.ray_count, 1))], axis=1
    )
    h = CELL / parts
    for step in range(layers * parts):
        z = step * h
        one = slope(z, state)
        two = slope(z + 0.5 * h, state + 0.5 * h * one)
        three = slope(z + 0.5 * h, state + 0.5 * h * two)
        four = slope(z + h, state + h * three)
        state = state + h / 6.0 * (one + 2.0 * two + 2.0 * three + four)
    return state


@pytest.mark.parametrize(
    ("geometry", "shape", "width", "allowed"),
    [
        ("volume", (11, 11, 9), 2.5, 1e-9),
        ("planar", (25, 17), 2.5, 1e-9),
        ("axisymmetric", (17, 17), 2.5, 1e-9),
        ("planar", (25, 17), 0.3, 1e-8),  # noise at the scale of cells: the other integrator's own error
    ],
)
def test_within_1e_9_wave_of_another_integrator(geometry, shape, width, allowed):
    """OPD within 1e-9 wave at a tolerance of 1e-9, position within 1e-14 m, direction within 1e-10 rad."""
    contrast = noise(shape, 3e-4, 5, width)
    rng = np.random.default_rng(2)
    position = np.c_[rng.uniform(-3e-4, 3e-4, (10, 2)), np.zeros(10)]
    rays = RayBundle(position, np.c_[rng.normal(0.0, 0.05, (10, 2)), np.ones(10)])
    result = by_reference(field_of(geometry, contrast), rays, tolerance=1e-9)
    layers = shape[-1] - 1
    coarse, fine = (by_z(scipy_potential(geometry, contrast), rays, layers, parts) for parts in (24, 48))
    best = fine + (fine - coarse) / 15.0
    assert result.ok.all() and np.abs(result.opd).max() > 1e-2 * WAVE
    assert np.abs(result.opd - best[:, 4]).max() < allowed * WAVE
    assert np.abs(result.position[:, :2] - best[:, :2]).max() < 1e-14 * allowed / 1e-9
    index = np.linalg.norm(best[:, 2:4] - AMBIENT * result.direction[:, :2], axis=1)
    assert index.max() < 1e-3  # the same ray; its direction below
    top = np.sqrt(AMBIENT**2 + 2.0 * scipy_potential(geometry, contrast)(best[:, 0], best[:, 1], layers * CELL)[0])
    assert np.abs(best[:, 2:4] / top[:, None] - result.direction[:, :2]).max() < 1e-10
    assert (result.step_error > 0.0).all() and result.step_error.max() < 1e-9 * WAVE


@pytest.mark.parametrize("geometry", first_of(["volume", "axisymmetric"]))
def test_exact_rays_in_a_strong_medium(geometry):
    """n^2 = n0^2 (1 - g^2 rho^2), n0 = 1.5, three pitches: cubic splines hold it, so rounding is all that is left.

    Over sigma x = x0 cos(w sigma) + p0 / w sin(w sigma), w = n0 g, and the optical path is the integral of n^2.
    """
    n0, g, ambient, length = 1.5, 100.0, 1.4, 0.19
    across, along = np.linspace(-4e-3, 4e-3, 17), np.linspace(0.0, length, 21)
    axes = [across[8:], along] if geometry == "axisymmetric" else [across, across, along]
    nodes = np.meshgrid(*axes, indexing="ij")
    square = n0**2 * (1.0 - g**2 * sum(x**2 for x in nodes[:-1]))
    field = IndexField.from_samples(
        np.sqrt(square) - ambient, origin=[a[0] for a in axes], spacing=[a[1] - a[0] for a in axes], geometry=geometry,
        ambient_index=ambient,
    )  # fmt: skip
    rng = np.random.default_rng(8)
    rays = RayBundle(
        np.c_[rng.uniform(-1.5e-3, 1.5e-3, (8, 2)), np.zeros(8)], np.c_[rng.normal(0.0, 0.05, (8, 2)), np.ones(8)]
    )
    result = by_reference(field, rays, until=Plane((0.0, 0.0, length), UP), tolerance=1e-9)
    x0 = rays.position[:, :2]
    index = n0 * np.sqrt(1.0 - g**2 * np.sum(x0**2, axis=1))
    tangent, w = index[:, None] * rays.direction, n0 * g
    sigma = length / tangent[:, 2]
    b, turn = tangent[:, :2] / w, w * sigma[:, None]
    end = x0 * np.cos(turn) + b * np.sin(turn)
    swing = np.sin(2.0 * turn) / (4.0 * w)
    squares = (
        x0**2 * (sigma[:, None] / 2 + swing) + b**2 * (sigma[:, None] / 2 - swing) + x0 * b * np.sin(turn) ** 2 / w
    )
    path = n0**2 * (sigma - g**2 * squares.sum(axis=1))
    assert result.ok.all()
    assert np.abs(result.position[:, :2] - end).max() < 2e-14
    assert np.abs(result.optical_path - path).max() < 5e-15
    assert (np.abs(result.optical_path - path) < 2.0 * result.step_error + 1e-15).all()


def test_its_own_error_is_honest():
    """A thousand times tighter moves no ray by more than what was said; noise at the scale of cells, every stop."""
    field = field_of("volume", 1e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, (11, 11, 9)))
    rng = np.random.default_rng(2)
    rays = RayBundle(np.c_[rng.uniform(-4e-4, 4e-4, (12, 2)), np.full(12, -1e-4)], [[0.02, 0.05, 1.0]])
    for until in (None, Plane((0.0, 0.0, 2e-3), (0.0, 1.0, 1.0)), ArcLength(7e-4)):
        result = by_reference(field, rays, until=until, tolerance=1e-9)
        tighter = by_reference(field, rays, until=until, tolerance=1e-12)
        assert (result.step_count < tighter.step_count).any()
        assert (np.abs(result.opd - tighter.opd) <= result.step_error + tighter.step_error).all()
        assert (result.step_error > 0.0).all()


def parallelogram(geometry: str = "planar") -> QuadMesh:
    """10 mm along z, sheared in z by 5 mm: its bounding box has two corners without cells."""
    share, up = np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 21), indexing="ij")
    low = -5e-3 if geometry == "planar" else 0.0
    return QuadMesh.structured(low + 10e-3 * share, 10e-3 * up + 5e-3 * share, geometry)


@pytest.mark.parametrize("interpolation", ["bilinear", "bilinear-barron", "idw"])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("stop", [None, Plane((0.0, 0.0, 20e-3), UP), ArcLength(23e-3)])
def test_a_mesh_that_does_not_fill_its_box(geometry, interpolation, stop):
    """A constant contrast c in a parallelogram: rays along z cross 10 mm of it, OPD = c * 10 mm, whatever the gaps."""
    contrast = 1e-4
    field = IndexField.from_mesh(
        mesh := parallelogram(geometry), np.full(len(mesh.vertices), contrast), interpolation=interpolation
    )
    y = np.array([-4e-3, -1e-3, 2e-3, 4e-3]) if geometry == "planar" else np.array([1e-3, 2.5e-3, 6e-3, 9e-3])
    result = by_reference(field, RayBundle(np.c_[np.zeros(4), y, np.full(4, -3e-3)], UP), until=stop)
    assert result.ok.all()
    np.testing.assert_allclose(result.opd, contrast * 10e-3, rtol=1e-12)
    np.testing.assert_allclose(result.direction, np.tile(UP, (4, 1)), atol=1e-12)


def test_through_a_hole_in_a_mesh():
    """A ring of cells round a square hole without any: OPD counts the cells alone, on slanted rays too."""
    y, z = np.meshgrid(np.linspace(-3e-3, 3e-3, 7), np.linspace(0.0, 6e-3, 7), indexing="ij")
    whole = QuadMesh.structured(y, z)
    middle = whole.cell_centroid
    hole = (np.abs(middle[:, 0]) < 1e-3) & (np.abs(middle[:, 1] - 3e-3) < 1e-3)
    used = np.unique(whole.cells[~hole])
    number = np.full(len(whole.vertices), -1)
    number[used] = np.arange(len(used))
    mesh = QuadMesh(whole.vertices[used], number[whole.cells[~hole]])
    field = IndexField.from_mesh(mesh, np.full(len(used), 1e-4))
    slant = np.array([0.0, 0.1, 1.0]) / np.hypot(0.1, 1.0)
    rays = RayBundle([[0.0, 0.5e-3, -1e-3], [0.0, 2e-3, -1e-3], [0.0, -0.3e-3, 0.0]], [UP, UP, slant])
    result = by_reference(field, rays)
    lengths = np.array([4e-3, 6e-3, 4e-3 * np.hypot(0.1, 1.0)])
    np.testing.assert_allclose(result.opd, 1e-4 * lengths, rtol=1e-12)


@pytest.mark.parametrize("on_mesh", [False, True])
def test_a_kink_is_met_exactly(on_mesh):
    """With s = g min(y, 0), piecewise linear, there are two parabolas over sigma, joined where the ray passes y = 0.

    The linear interpolant of samples of s holds it exactly on a grid; on a mesh the contrast is interpolated, whose
    potential m (a + m / 2) differs from linear by 1e-4^2 / 8, so there the bend is compared to 1e-5 of itself.
    """
    slope, y0, tilt, length = 0.1, -3.3e-4, 0.3, 3e-3
    y = np.arange(-20, 21) * CELL
    s = slope * np.minimum(y, 0.0)
    contrast = np.repeat((2.0 * s / (np.sqrt(AMBIENT**2 + 2.0 * s) + AMBIENT))[:, None], 31, axis=1)
    if on_mesh:
        mesh = QuadMesh.structured(*np.meshgrid(y, np.arange(31) * CELL, indexing="ij"))
        field = IndexField.from_mesh(mesh, contrast, ambient_index=AMBIENT)
    else:
        field = IndexField.from_samples(
            contrast, origin=(y[0], 0.0), spacing=(CELL, CELL), geometry="planar", interpolation="linear",
            ambient_index=AMBIENT,
        )  # fmt: skip
    heading = np.array([0.0, tilt, 1.0]) / np.hypot(tilt, 1.0)
    result = by_reference(field, RayBundle([[0.0, y0, 0.0]], [heading]), until=Plane((0.0, 0.0, length), UP))
    index = np.sqrt(AMBIENT**2 + 2.0 * slope * y0)
    p, w = index * heading[1], index * heading[2]
    first = (-p + np.sqrt(p * p - 2.0 * slope * y0)) / slope  # sigma at y = 0
    beyond = p + slope * first
    assert abs(result.direction[0, 1] / result.direction[0, 2] - beyond / w) < (1e-9 if on_mesh else 1e-14)
    end = beyond * (length / w - first)
    assert abs(result.position[0, 1] - end) < (1e-11 if on_mesh else 1e-16)
    work = 2.0 * slope * (y0 * first + 0.5 * p * first**2 + slope * first**3 / 6.0)
    further = AMBIENT**2 * length / w - AMBIENT * length / heading[2]
    assert abs(result.opd[0] - (work + further)) < (1e-13 if on_mesh else 1e-17)


def test_a_ridge_is_no_trap():
    """Light on the edge of a roof of contrast stays there and arrives: OPD 0, the roof's on its edge."""
    y = np.arange(-5, 6) * CELL
    roof = np.repeat((-20.0 * np.abs(y))[:, None], 11, axis=1)
    field = IndexField.from_samples(
        roof, origin=(-5e-4, 0.0), spacing=(CELL, CELL), geometry="planar", interpolation="linear"
    )
    result = by_reference(field, RayBundle([[0.0, 0.0, -1e-3]], UP), until=Plane((0.0, 0.0, 2e-3), UP))
    assert result.status[0] == RayStatus.OK and abs(result.opd[0]) < 1e-9 * WAVE


def test_thin_plates_and_stepped_bodies_are_met_exactly():
    """A plate of 20 um in a field of 0.2 mm cells stops its rays on its face; the others miss it by a micrometre.

    A body with a step, radius 4 to 2 mm: rays from within begin at the face that they leave by.
    """
    plate = Body([[-3e-3, 3e-3], [3e-3, 3e-3], [3e-3, 3.02e-3], [-3e-3, 3.02e-3]], "planar")
    field = IndexField.from_samples(
        np.full((51, 51), 3e-4), origin=(-5e-3, -2e-3), spacing=(2e-4, 2e-4), geometry="planar", body=plate
    )
    y = np.array([-3.001e-3, -2.999e-3, 0.0, 2.999e-3, 3.001e-3])
    result = by_reference(field, RayBundle(np.c_[np.zeros(5), y, np.full(5, -1e-3)], UP))
    assert result.traced_status.tolist() == [0, RayStatus.HIT_BODY, RayStatus.HIT_BODY, RayStatus.HIT_BODY, 0]
    np.testing.assert_allclose(result.position[1:4, 2], 3e-3, atol=1e-15)
    step = Body([[0, 0], [2e-3, 0], [2e-3, -5e-3], [4e-3, -5e-3], [4e-3, -20e-3], [0, -20e-3]])
    field = IndexField.from_samples(
        np.full((26, 101), 3e-4), origin=(0.0, -20e-3), spacing=(4e-4, 4e-4), geometry="axisymmetric", body=step
    )
    radius = np.array([0.0, 1.999e-3, 2.001e-3, 3.999e-3])
    rays = RayBundle(np.c_[0.6 * radius, 0.8 * radius, np.full(4, -10e-3)], UP)
    result = by_reference(field, rays, until=Plane((0.0, 0.0, 30e-3), UP))
    np.testing.assert_allclose(result.opd, 3e-4 * np.array([20e-3, 20e-3, 25e-3, 25e-3]), rtol=1e-12)


def test_one_ray_does_not_depend_on_the_others():
    """A bundle is traced in step, each ray with its own steps: alone it ends in the same place."""
    field = field_of("axisymmetric", noise((17, 17), 3e-4, 5, 1.0))
    rng = np.random.default_rng(4)
    start = np.c_[rng.uniform(-1e-3, 1e-3, (40, 2)), rng.uniform(2e-4, 1.4e-3, 40)]
    rays = RayBundle(start, rng.normal(0.0, 1.0, (40, 3)))
    together = by_reference(field, rays)
    for k in (0, 7, 23):
        alone = by_reference(field, rays[k : k + 1])
        assert alone.status[0] == together.status[k]
        np.testing.assert_allclose(alone.opd[0], together.opd[k], rtol=0.0, atol=1e-17)
        np.testing.assert_allclose(alone.position[0], together.position[k], rtol=0.0, atol=1e-17)
