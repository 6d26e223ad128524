"""Pupils of every shape: areas, sampling, coverage of grids, and the same points on every backend."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import (
    Annulus,
    Disc,
    IndexField,
    Mask,
    Polygon,
    RayBundle,
    Rectangle,
    Scene,
    estimate_strehl,
    wavefront,
)
from aerokernels.prepare import prepare_field
from aerokernels.pupils import Pupil
from tests.phase_plates import WAVELENGTH, phase_plate
from tests.tracing.backends import on

GAUSSIAN = np.exp(-np.sum(np.stack(np.meshgrid(*[np.linspace(-2.0, 2.0, 40)] * 2)) ** 2, axis=0))
ARROW = [[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [1.0, 0.5], [0.0, 2.0]]
SHAPES: dict[str, Pupil] = {
    "disc": Disc(2e-3),
    "annulus": Annulus(2e-3, 0.8e-3),
    "rectangle": Rectangle(4e-3, 2e-3),
    "polygon": Polygon(1e-3 * np.array(ARROW)),
    "mask": Mask([[0.0, 1.0, 2.0], [3.0, 0.0, 1.0]], 1e-3),
    "gaussian": Mask(GAUSSIAN, 1e-4),
}
AREAS = {
    "disc": 4e-6 * np.pi,
    "annulus": (4.0 - 0.64) * 1e-6 * np.pi,
    "rectangle": 8e-6,
    "polygon": 3.75e-6,
    "mask": 7e-6,
    "gaussian": 1e-8 * GAUSSIAN.sum(),
}


def moments_by_coverage(pupil: Pupil, count: int = 801) -> np.ndarray:
    """<x>, <y>, <xx>, <xy>, <yy> by the exact transmission of fine cells; error: 1/12 of a cell's size squared."""
    edges = [np.linspace(-extent, extent, count + 1) for extent in pupil.half_extent]
    share = pupil.coverage(*edges)
    x, y = np.meshgrid(*(0.5 * (edge[1:] + edge[:-1]) for edge in edges))
    return np.array([(share * term).sum() for term in (x, y, x * x, x * y, y * y)]) / share.sum()


@pytest.mark.parametrize("name", SHAPES)
def test_area_and_coverage_agree(name: str):
    """Cells of any grid share out the pupil's area exactly; rounding of second differences: 1e-11 of the whole."""
    pupil = SHAPES[name]
    x, y = np.linspace(-4.1e-3, 4.3e-3, 34), np.linspace(-3.9e-3, 4.2e-3, 51)
    covered = pupil.coverage(x, y)
    assert covered.shape == (50, 33) and covered.min() >= 0.0
    assert pupil.area == pytest.approx(AREAS[name], rel=1e-12)
    assert (covered * np.outer(np.diff(y), np.diff(x))).sum() == pytest.approx(pupil.area, rel=1e-10)


@pytest.mark.parametrize("sampling", ["sobol", "gauss", "grid", "random"])
@pytest.mark.parametrize("name", SHAPES)
def test_samples_have_the_pupils_moments(name: str, sampling: str):
    """Tolerances in units of reach: 3 / n^0.5 for random points, 1 / n^0.75 for Sobol, a cell's share for the grid."""
    pupil = SHAPES[name]
    points, weight = pupil.sample(4096, sampling, 3)
    assert weight.sum() == pytest.approx(1.0, abs=1e-12) and points.shape == (len(weight), 3)
    if sampling in ("sobol", "random"):
        assert len(weight) == 4096
    assert 0.4 * 4096 < len(weight) < 2.5 * 4096 and (points[:, 2] == 0.0).all()
    x, y = points[:, :2].T
    found = np.array([weight @ term for term in (x, y, x * x, x * y, y * y)])
    scale = pupil.reach ** np.array([1, 1, 2, 2, 2])
    allowed = {"sobol": 2e-3, "random": 4e-2, "grid": 5e-3, "gauss": 3e-4 if name == "gaussian" else 1e-5}[sampling]
    assert np.abs((found - moments_by_coverage(pupil)) / scale).max() < allowed


def test_gauss_points_are_exact_for_polynomials():
    """<x^2 y^2> on a rectangle a b: (a b)^2 / 144; <x^2> of a triangle from its corners; <r^4> of a ring."""
    points, weight = Rectangle(4.0, 2.0).sample(100, "gauss")
    assert weight @ (points[:, 0] ** 2 * points[:, 1] ** 2) == pytest.approx(64.0 / 144.0, rel=1e-13)
    points, weight = Polygon([[0.0, 0.0], [3.0, 0.0], [0.0, 1.0]]).sample(64, "gauss")
    assert weight @ points[:, 0] ** 2 == pytest.approx(9.0 / 6.0, rel=1e-13)
    points, weight = Annulus(2.0, 1.0).sample(100, "gauss")
    assert weight @ np.sum(points**2, axis=1) ** 2 == pytest.approx((64.0 - 1.0) / (3.0 * 3.0), rel=1e-13)


angles = st.lists(st.floats(0.05, 1.0), min_size=3, max_size=12)


@given(steps=angles, radii=st.lists(st.floats(0.2, 1.0), min_size=12, max_size=12), turn=st.booleans())
@settings(max_examples=60, deadline=None)
def test_any_star_shaped_polygon_is_cut_up_and_covered_alike(steps, radii, turn):
    """Triangles make up the area that the shoelace formula gives, and so do the cells of a grid."""
    angle = 2.0 * np.pi * np.cumsum(steps) / np.sum(steps)
    if np.diff(angle, prepend=angle[-1] - 2.0 * np.pi).max() > 3.0:
        return  # not star-shaped about the origin
    corner = np.array(radii[: len(angle)])[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pupil = Polygon(corner[::-1] if turn else corner)
    a, b = corner, np.roll(corner, -1, axis=0)
    area = 0.5 * abs(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    _, first, second = pupil._triangles
    pieces = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) * pupil.reach**2
    assert (pieces > 0.0).all() and pieces.sum() == pytest.approx(area, rel=1e-9)
    edges = np.linspace(-1.1, 1.1, 24)
    assert pupil.coverage(edges, edges).sum() * (2.2 / 23) ** 2 == pytest.approx(area, rel=1e-9)


def test_a_pupil_looks_along_its_normal_from_its_centre():
    """Points lie in the plane through the centre across the normal, at a distance of at most the reach."""
    center, normal = np.array([1.0, 2.0, 3.0]), np.array([1.0, -2.0, 0.5])
    for pupil in (Annulus(0.2, 0.1, center, normal), Polygon(0.1 * np.array(ARROW), center, normal)):
        rays = RayBundle.through(pupil, center + 5.0 * pupil.normal, 64, toward_point=True)
        offset = rays.position - center
        assert np.abs(offset @ pupil.normal).max() < 1e-15
        assert np.linalg.norm(offset, axis=1).max() <= pupil.reach * (1.0 + 1e-12)
        assert (rays.direction @ pupil.normal > 0.9).all()


def plate_opd(x, y):
    """Tilt, focus, astigmatism and coma of some tenths of a wave [m]."""
    x, y = x / 2e-3, y / 2e-3
    return 1e-7 * (0.5 * x + 0.8 * (x * x + y * y) - 0.6 * x * y + 0.4 * x * (x * x + y * y))


@functools.cache
def plate():
    """The field of that OPD, one for all tests."""
    return phase_plate(plate_opd, 4.2e-3)


@functools.cache
def by_quadrature(name: str, remove: tuple[str, ...]) -> tuple[float, float]:
    """Strehl ratio and rms of that OPD over fine cells of a shape, terms removed by weighted least squares."""
    pupil = SHAPES[name]
    edges = [np.linspace(-extent, extent, 402) for extent in pupil.half_extent]
    share = pupil.coverage(*edges).ravel()
    x, y = (axis.ravel() for axis in np.meshgrid(*(0.5 * (edge[1:] + edge[:-1]) for edge in edges)))
    share, x, y = share[share > 0.0] / share.sum(), x[share > 0.0], y[share > 0.0]
    basis = {"tilt": [x, y], "focus": [x * x + y * y]}
    columns = np.stack([np.ones_like(x), *(column for term in remove for column in basis.get(term, []))], axis=1)
    root = np.sqrt(share)
    opd = plate_opd(x, y)
    opd = opd - columns @ np.linalg.lstsq(columns * root[:, None], opd * root, rcond=None)[0]
    return abs(share @ np.exp(2j * np.pi / WAVELENGTH * opd)) ** 2, float(np.sqrt(share @ opd**2))


REMOVED = [("piston",), ("piston", "tilt"), ("piston", "focus"), ("tilt", "focus")]
CASES = [(name, engine, REMOVED[k % 4]) for k, name in enumerate(SHAPES) for engine in ("warp-cpu", "opencl-cpu")]
CASES += [("mask", engine, remove) for remove in REMOVED for engine in ("warp-cpu", "opencl-cpu")]
CASES += [("mask", "reference", REMOVED[2])]  # the slow oracle


@pytest.mark.parametrize(("name", "engine", "remove"), CASES)
def test_strehl_ratio_of_a_phase_plate_through_every_shape(name: str, engine: str, remove: tuple[str, ...]):
    """Expected: the same mean over 401 x 401 cells; tolerance: 1e-3 of 16 x 1024 Sobol points, the plate's own 1e-5."""
    options = {"backend": "reference"} if engine == "reference" else on(engine)
    pupil = SHAPES[name]
    ray_count = 256 if engine == "reference" else 1 << 14
    found = estimate_strehl(plate(), pupil, ray_count=ray_count, wavelength=WAVELENGTH, remove=remove, **options)
    ratio, rms = by_quadrature(name, remove)
    allowed = 3e-2 if engine == "reference" else 1e-3
    assert found.value == pytest.approx(ratio, abs=allowed)
    assert found.opd_rms == pytest.approx(rms, rel=allowed + 4e-3)
    assert found.blocked == 0.0


@pytest.mark.parametrize("engine", ["warp-cpu", "opencl-cpu"])
def test_sizes_in_single_precision_are_those_numbers(engine: str):
    """As slices of float32 arrays have them. By OpenCL the annulus lost its obstruction, by Warp the launch failed."""
    field, options = plate(), {"ray_count": 1 << 10, "wavelength": WAVELENGTH, **on(engine)}
    outer, inner = np.float32(2e-3), np.float32(1.5e-3)
    found = estimate_strehl(field, Annulus(outer, inner), **options)
    assert found.value == estimate_strehl(field, Annulus(float(outer), float(inner)), **options).value


def test_an_annulus_on_the_axis_is_traced_by_radial_quadrature():
    """Axisymmetric field and pupil: radial quadrature gives the Strehl ratio of the annulus, focus removed or not."""
    r, z = np.linspace(0.0, 5e-3, 51), np.linspace(0.0, 4e-3, 25)
    contrast = 2e-4 * np.exp(-((r[:, None] / 2e-3) ** 2)) * np.sin(np.pi * z / z[-1]) ** 4
    field = IndexField.from_samples(
        contrast, origin=(0.0, 0.0), spacing=(r[1], z[1]), geometry="axisymmetric", ambient_index=1.0
    )
    pupil = Annulus(3e-3, 1.5e-3, (0.0, 0.0, -1e-3))
    for remove in (("piston",), ("piston", "tilt", "focus")):
        fan = estimate_strehl(field, pupil, ray_count=1 << 15, wavelength=WAVELENGTH, remove=remove, symmetry=True)
        every = estimate_strehl(field, pupil, ray_count=1 << 15, wavelength=WAVELENGTH, remove=remove, symmetry=False)
        assert fan.traced_ray_count < 1 << 15
        assert fan.value == pytest.approx(every.value, abs=3.0 * every.standard_error + 1e-5)
        assert fan.opd_rms == pytest.approx(every.opd_rms, rel=2e-3)
    with pytest.raises(ValueError, match="the pupil is a Rectangle, not round"):
        estimate_strehl(field, Rectangle(1e-3, 1e-3), wavelength=WAVELENGTH, symmetry=True)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Annulus(1.0, 1.0), "inner_radius of an Annulus must be at least 0 m and below its radius"),
        (lambda: Annulus(1.0, -0.1), "inner_radius of an Annulus"),
        (lambda: Rectangle(1.0, 0.0), "height of a Rectangle must be positive and finite, got 0.0"),
        (lambda: Polygon([[0, 0], [1, 0]]), r"of shape \(3 or more, 2\), got \(2, 2\)"),
        (lambda: Polygon([[0, 0], [1, 1], [2, 2]]), "they lie on a line"),
        (lambda: Polygon([[0, 0], [1, 1], [1, 0], [0, 2]]), "edges 0 and 2 of the Polygon meet"),
        (lambda: Mask([1.0, 2.0], 1.0), "array of two axes"),
        (lambda: Mask([[0.0, 0.0]], 1.0), "all zero"),
        (lambda: Mask([[1e308, 1e308]], 1.0), r"greatest weight of a Mask is 1e\+308: scale"),
        (lambda: Mask([[0.0, 1e-310]], 1.0), "scale the weights to about 1"),
        (lambda: Mask([[1.0, -1.0]], 1.0), r"1 weights of a Mask are negative or not finite, the first is \(0, 1\)"),
        (lambda: Mask([[1.0]], -1.0), "pixel of a Mask must be positive"),
        (lambda: Mask([[1.0]], (1.0, 2.0, 3.0)), "must be one length or two"),
        (lambda: Rectangle(1.0, 1.0, (0, 0), (0, 0, 1)), "Rectangle center must be three finite numbers"),
    ],
)
def test_what_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("name", SHAPES)
def test_transmission_at_points_is_that_of_fine_cells(name: str):
    """Points in the middle of cells that the pupil covers evenly: the same transmission."""
    pupil = SHAPES[name]
    edges = np.linspace(-4e-3, 4e-3, 161)
    middle = 0.5 * (edges[1:] + edges[:-1])
    cover, square = pupil.coverage(edges, edges), pupil.coverage(edges, edges, 2)
    found = pupil.transmission(middle[None, :], middle[:, None])
    even = np.abs(square - cover**2) < 1e-9
    assert even.mean() > 0.5 and np.abs(found - cover)[even].max() < 1e-6


def test_a_scenes_receiver_has_a_shape():
    """Area and centre of each; the disc of equal area collects as much; keys that do not go together are refused."""
    disc = Scene.load("wind-tunnel-mach3").receiver
    assert isinstance(disc.pupil, Disc) and 2.0 * disc.pupil.radius == disc.diameter == 12e-3
    ring = Scene.load("wind-tunnel-mach3", {"receiver.shape": "annulus", "receiver.inner_diameter": "4 mm"}).receiver
    assert isinstance(ring.pupil, Annulus) and ring.pupil.center[2] == -8e-3
    wide = Scene.load("wind-tunnel-mach3", {"receiver.shape": "rectangle", "receiver.height": "3 mm"}).receiver
    assert isinstance(wide.pupil, Rectangle) and wide.pupil.area == pytest.approx(36e-6)
    for changes, message in (
        ({"receiver.shape": "annulus"}, 'shape = "annulus" needs inner_diameter'),
        ({"receiver.inner_diameter": "4 mm"}, "no other shape takes it"),
        ({"receiver.shape": "annulus", "receiver.inner_diameter": "12 mm"}, "must be below receiver.diameter"),
        ({"receiver.height": "4 mm"}, 'belongs to shape = "rectangle"'),
    ):
        with pytest.raises(ValueError, match=message):
            Scene.load("wind-tunnel-mach3", changes)


def test_an_annular_receiver_goes_through_the_job():
    """Its map of the wavefront is dark in the middle; the echo's rays leave the ring; air at rest takes nothing off."""
    changes = {"flow.source": "static", "receiver.shape": "annulus", "receiver.inner_diameter": "6 mm"}
    scene = Scene.load("wind-tunnel-mach3", {**changes, "receiver.ray_count": "32", "grid.spacing": "0.4 mm"})
    field = prepare_field(scene).field
    opd = wavefront(field, scene.view, pixel_count=21).opd
    assert np.isnan(opd[10, 7:14]).all() and np.isfinite(opd[10, [0, 1, 4, 15, 20]]).all()
    start, weight = scene.receiver.pupil.sample(32, "gauss")
    assert np.hypot(*start[:, :2].T).min() > 3e-3 and weight.sum() == pytest.approx(1.0)
    assert estimate_strehl(field, scene.receiver.pupil, ray_count=1024).value == pytest.approx(1.0, abs=1e-9)
