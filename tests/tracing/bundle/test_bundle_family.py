"""Families of two parameters: what is recognised in raw arrays, patches between lines, the bound from the field."""

import re

import numpy as np
import pytest

from aerokernels import ArcLength, IndexField, Plane, RayBundle, trace
from aerokernels.tracing.bundle.tubes import Tubes
from aerokernels.tracing.tasks.family import Family, find_family

H = 1e-3 / 16
FAR = Plane((0.0, 0.0, 4e-3), (0.0, 0.0, 1.0))


def volume(contrast: np.ndarray, interpolation: str = "cubic") -> IndexField:
    origin = [-H * (count - 1) / 2 for count in contrast.shape]
    return IndexField.from_samples(
        contrast,
        origin=origin,
        spacing=(H,) * 3,
        geometry="volume",
        ambient_index=1.00027,
        interpolation=interpolation,
    )


FIELD = volume(np.zeros((33, 33, 33)))
RNG = np.random.default_rng(4)
PLACES = np.c_[RNG.uniform(-8e-4, 8e-4, (400, 2)), np.full(400, -1.2e-3)]
OBLIQUE = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])


def found(position, direction, until=FAR) -> Family:
    family = find_family(FIELD, RayBundle(position, direction), until)
    assert isinstance(family, Family), family
    return family


def through(apex, position) -> np.ndarray:
    way = np.asarray(position) - apex
    return way * np.sign(way[:, 2:]) / np.linalg.norm(way, axis=1)[:, None]


@pytest.mark.parametrize(
    ("position", "direction", "until", "why"),
    [
        (PLACES, RNG.normal([0.0, 0.0, 1.0], 0.02, (400, 3)), FAR, "neither parallel nor meet"),
        (RNG.uniform(-5e-4, 5e-4, (400, 3)), np.tile(OBLIQUE, (400, 1)), FAR, "neither in one plane nor ahead"),
        (PLACES - RNG.uniform(0, 1e-3, (400, 1)) * OBLIQUE, np.tile(OBLIQUE, (400, 1)), ArcLength(3e-3), "neither in"),
        (PLACES[:1].repeat(400, 0), np.tile(OBLIQUE, (400, 1)), FAR, "one ray"),
        (np.zeros((400, 3)), RNG.normal(size=(400, 3)), FAR, "axis|angle"),
    ],
    ids=["incoherent", "from within", "arc lengths", "one ray", "all directions"],
)
def test_what_is_no_smooth_map_is_refused(position, direction, until, why: str):
    reason = find_family(FIELD, RayBundle(position, direction), until)
    assert isinstance(reason, str)
    assert re.search(why, reason)


def test_the_bound_holds_for_waves_and_sees_a_needle():
    """With a cos(k x) over L = 2 mm and lines s apart patches err by a L (k s)^4 / 384 at least; the bound says more.

    A needle of one node, which no line meets, is bounded by more than what it adds to a line through it.
    """
    x = (np.arange(33) - 16) * H
    wave = 1e-5 * np.cos(2.0 * np.pi * x / (16 * H))[:, None, None] * np.ones((33, 33, 33))
    step = np.full(2, 2.0 * H)
    position = np.c_[PLACES[:, :2], np.full(400, -1.2e-3)]
    family = found(position, np.tile([0.0, 0.0, 1.0], (400, 1)))

    def bound(field: IndexField) -> float:
        tubes = Tubes.of(field, family, FAR, False)
        assert tubes is not None
        return float(tubes.missed(np.zeros((1, 2)), 2.0 * step, step, np.zeros(1))[0])

    least = 1e-5 * 32 * H * (2.0 * np.pi / 8.0) ** 4 / 384.0
    assert least < bound(volume(wave)) < 40.0 * least
    assert bound(FIELD) == 0.0
    needle = np.zeros((33, 33, 33))
    needle[17, 15, 4] = 1e-4
    assert bound(volume(needle)) > 1e-4 * H
    for kind in ("linear", "monotone"):
        assert bound(volume(needle, kind)) > 1e-4 * H


def test_lines_that_count_as_one_cost_less_than_the_tolerance():
    """A ray moved by x changes its path by x times its turn: a millionth of a cell of 50 mm turned by 0.2 rad is much.

    Through n^2 = 1.69 + 0.08 y the lines of a pencil miss its apex by up to 20 nm, which changes the OPD by 4e-9 m,
    four tolerances of 1e-3 waves. No ray may have a greater error than the tolerance, also if exact lines at a looser
    tolerance were traced before. Error control alone is right within a tenth of it.
    """
    y, z = np.linspace(-2.0, 2.0, 81), np.linspace(-5.0, 5.0, 81)
    contrast = np.sqrt(1.69 + 0.08 * y)[:, None] - 1.3 + 0.0 * z
    field = IndexField.from_samples(
        contrast, origin=(y[0], z[0]), spacing=(y[1] - y[0], z[1] - z[0]), geometry="planar", ambient_index=1.3
    )
    rng = np.random.default_rng(8)
    place = np.c_[rng.uniform(-0.5, 0.5, (10_000, 2)), np.full(10_000, -3.0)]
    way = place - [0.0, 0.1, -10.0]
    moved = place + np.c_[rng.uniform(-2e-8, 2e-8, (10_000, 2)), np.zeros(10_000)]
    until = Plane((0.0, 0.0, 3.0), (0.0, 0.0, 1.0))
    loose = trace(field, RayBundle(place, way), until=until, tolerance=1.0, outputs="opd", precision="float64")
    assert loose.plan.bundle is not None
    for rays in (RayBundle(place, way), RayBundle(moved, way)):
        options = {"until": until, "tolerance": 1e-3, "outputs": "opd", "precision": "float64"}
        assert_within(trace(field, rays, **options), trace(field, rays, bundle="off", **options), 1e-3)


def assert_within(result, every_ray, tolerance: float) -> None:
    """Check that no OPD differs by more than the tolerance [waves] from that of rays traced one by one."""
    assert (result.status == every_ray.status).all()
    assert np.abs(result.opd - every_ray.opd).max() <= 1.1 * tolerance * result.wavelength
