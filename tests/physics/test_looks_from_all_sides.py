"""Fields of every geometry seen from all sides, through every door, against an independent tracer in float64.

Set-up: smooth air on a coarse grid, at rest at all faces. Looks are drawn over the whole sphere; pupils begin in the
air or before it. The tracer below is classic RK4 in fixed steps through SciPy's interpolating spline of the potential
(n^2 - 1) / 2, which is the field's interpolant (mirrored about an axis of symmetry, with not-a-knot ends); it stops
where all of its rays have left the field. Halving its steps changes no path by more than 1e-6 wave.

Tolerance: each number is within three times its own error.
"""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, RectBivariateSpline

from aerokernels import Disc, Plane, RayBundle, estimate_strehl, flow, look_map, optical_series, trace, wavefront

pytestmark = pytest.mark.slow

WAVELENGTH, CONSTANT = 905e-9, 2.2e-4
STEPS, RINGS, SPOKES = 240, 12, 24


def at_rest(count: int, both: bool = True) -> np.ndarray:
    """A window over nodes that falls to 0 at the last one, or at both ends, with two continuous derivatives."""
    place = np.linspace(0.0, 1.0, count)
    share = np.clip(np.minimum(place, 1.0 - place) / 0.25 if both else (1.0 - place) / 0.25, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


class Air:
    """A field and its own tracer: potential X(x) P(y, z), or P(r, z)."""

    def __init__(self, geometry: str, draw: np.random.Generator):
        """Draw the air: two blobs of up to half a wave."""
        self.geometry, self.step = geometry, draw.uniform(6e-4, 1.2e-3, size=2)
        counts = draw.integers(26, 34, size=2)
        self.high = self.step * (counts - 1) * (0.5 if geometry != "axisymmetric" else np.array([1.0, 0.5]))
        self.low = np.where([geometry == "axisymmetric", False], 0.0, -self.high)
        axes = [low + step * np.arange(count) for low, step, count in zip(self.low, self.step, counts, strict=True)]
        first, second = np.meshgrid(*axes, indexing="ij")
        blobs = 0.0
        for sign in (1.0, -0.6):
            middle, size = draw.uniform(-0.3, 0.3, size=2) * self.high, draw.uniform(0.25, 0.5, size=2) * self.high
            middle[0] *= geometry != "axisymmetric"
            blobs = blobs + sign * np.exp(
                -(((first - middle[0]) / size[0]) ** 2) - ((second - middle[1]) / size[1]) ** 2
            )
        window = at_rest(counts[0], geometry != "axisymmetric")[:, None] * at_rest(counts[1])
        plane = blobs * window / np.abs(blobs * window).max() * 0.5 * WAVELENGTH / self.high.max()
        self.contrast = plane
        origin, spacing = list(self.low), list(self.step)
        self.along = None
        if geometry == "volume":
            width = np.linspace(-self.high[0], self.high[0], 25)
            share = at_rest(25)
            self.along, self.contrast = CubicSpline(width, share), share[:, None, None] * plane
            origin, spacing = [width[0], *origin], [width[1] - width[0], *spacing]
        options = {"origin": origin, "spacing": spacing, "geometry": geometry, "ambient_density": 1.0}
        self.series = flow.open_series([1.0 + self.contrast / CONSTANT], time=[0.0], **options)
        self.field = self.series[0].index_field(WAVELENGTH, constant=CONSTANT)
        potential = plane * (1.0 + 0.5 * plane)
        if geometry == "axisymmetric":
            axes[0], potential = np.r_[-axes[0][:0:-1], axes[0]], np.r_[potential[:0:-1], potential]
        self.spline = RectBivariateSpline(*axes, potential)

    def force(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Potential and its gradient [1/m] at places (n, 3); 0 outside the field."""
        x, y, z = place.T
        first = np.hypot(x, y) if self.geometry == "axisymmetric" else y
        inside = (first <= self.high[0]) & (first >= self.low[0]) & (np.abs(z) <= self.high[1])
        if self.along is not None:
            inside &= np.abs(x) <= self.high[0]
        value, rise, slope = (
            np.where(inside, self.spline.ev(first, z, dx=a, dy=b), 0.0) for a, b in ((0, 0), (1, 0), (0, 1))
        )
        if self.geometry == "axisymmetric":
            outward = rise / np.maximum(first, 1e-300)
            return value, np.stack([outward * x, outward * y, slope], axis=1)
        if self.along is None:
            return value, np.stack([0.0 * x, rise, slope], axis=1)
        share, change = np.where(inside, self.along(x), 0.0), np.where(inside, self.along(x, 1), 0.0)
        return share * value, np.stack([change * value, share * rise, share * slope], axis=1)

    def way_out(self, start: np.ndarray, look: np.ndarray) -> float:
        """Length after which all lines have left the field's box, and one in a hundred more."""
        high = np.array([np.inf if self.geometry == "planar" else self.high[0], *self.high])
        with np.errstate(divide="ignore"):
            ways = (np.where(look > 0.0, high, -high) - start) / np.where(look == 0.0, 1e-300, look)
        return 1.01 * max(float(ways.min(axis=1).max()), 0.0) + 1e-4

    def paths(self, start: np.ndarray, look: np.ndarray) -> np.ndarray:
        """OPD [m] of rays along a look to the plane across it beyond the field, shape (n,)."""
        length = self.way_out(start, look)
        toward = look * (self.geometry != "planar", 1.0, 1.0)
        before = -np.linalg.norm(self.high[[0, 0, 1]]) - float((start @ toward).max())
        begin = max(before / float(toward @ toward), 0.0)
        step = (length - begin) / STEPS
        place, path = start + begin * look, np.zeros(len(start))
        turn = np.sqrt(1.0 + 2.0 * self.force(place)[0])[:, None] * look

        def rates(where: np.ndarray, momentum: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            value, force = self.force(where)
            return momentum, force, 2.0 * value  # d(optical path) / d(sigma) - 1

        for _ in range(STEPS):
            k1 = rates(place, turn)
            k2 = rates(place + 0.5 * step * k1[0], turn + 0.5 * step * k1[1])
            k3 = rates(place + 0.5 * step * k2[0], turn + 0.5 * step * k2[1])
            k4 = rates(place + step * k3[0], turn + step * k3[1])
            place, turn, path = (
                old + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                for old, a, b, c, d in zip((place, turn, path), k1, k2, k3, k4, strict=True)
            )
        return path + (length - (place - start) @ look) / (turn @ look)


def ring_points(pupil: Disc) -> tuple[np.ndarray, np.ndarray]:
    """Points of a disc, shape (n, 3), and their weights: Gauss's in the square of the radius, even in the angle."""
    place, weight = np.polynomial.legendre.leggauss(RINGS)
    radius, angle = pupil.radius * np.sqrt(0.5 * (place + 1.0)), 2.0 * np.pi * np.arange(SPOKES) / SPOKES
    across, up = (np.outer(radius, turn(angle)).reshape(-1, 1) for turn in (np.cos, np.sin))
    first, second = pupil.axes
    return pupil.center + across * first + up * second, np.repeat(weight / (2.0 * SPOKES), SPOKES)


def a_look(air: Air, draw: np.random.Generator) -> Disc:
    """A pupil that looks through the air in any direction, of a planar field at 8 degrees from its span or more."""
    look = draw.normal(size=3)
    while air.geometry == "planar" and np.hypot(*look[1:]) < 0.15 * np.linalg.norm(look):
        look = draw.normal(size=3)
    look /= np.linalg.norm(look)
    middle = np.array([draw.normal(), *draw.uniform(-0.3, 0.3, size=2)]) * air.high[[0, 0, 1]]
    size = np.linalg.norm(air.high) / (np.hypot(*look[1:]) if air.geometry == "planar" else 1.0)
    back = draw.choice([0.0, 1.5]) * size
    if air.geometry != "planar":
        middle[0] = 0.2 * air.high[0] * draw.uniform(-1.0, 1.0)
    return Disc(draw.uniform(0.1, 0.25) * air.high.min(), middle - back * look, look)


@pytest.mark.parametrize("number", range(10))
def test_every_door_agrees_with_an_independent_tracer(number: int):
    draw = np.random.default_rng(460 + number)
    air = Air(("planar", "axisymmetric", "volume", "planar", "planar")[number % 5], draw)
    field, pupil = air.field, a_look(air, draw)
    look, light = pupil.normal, {"wavelength": WAVELENGTH, "backend": ("opencl", "warp")[number % 2]}
    points, weight = ring_points(pupil)
    opd = air.paths(points, look)
    strehl = abs(weight @ np.exp(2j * np.pi / WAVELENGTH * opd)) ** 2

    plane = Plane(pupil.center + air.way_out(points, look) * look, look)
    rays = trace(field, RayBundle(points, np.tile(look, (len(points), 1))), until=plane, **light)
    assert rays.ok.all() and np.mean(np.abs(rays.opd - opd) <= 3.0 * rays.error["total"]) >= 0.9
    told = {
        "estimate": estimate_strehl(field, pupil, ray_count=4096, **light).quantities["value"],
        "wavefront": wavefront(field, pupil, pixel_count=24, **light).quantities["strehl"],
    }
    for door, found in told.items():
        assert abs(found.value - strehl) <= 3.0 * found.error, door
    angles = np.arctan2(look[0], look[2]), np.arcsin(look[1])
    seen = look_map(field, *angles, pupil, ray_count=4096, **light).isel(azimuth=0, elevation=0)
    # Its rays are within 1e-3 wave, to which a Strehl ratio is sensitive by 2 sqrt(S (1 - S)).
    rounding = 2e-3 * np.pi * 2.0 * np.sqrt(strehl * (1.0 - strehl)) + (2e-3 * np.pi) ** 2
    assert seen.known == 1.0 and abs(seen.strehl - strehl) <= 3.0 * (seen.strehl_standard_error + rounding)
    maps = optical_series(air.series, pupil, remove=(), pixel_count=16, constant=CONSTANT, **light).isel(time=0)
    assert float(maps.known) == pytest.approx(1.0) and abs(maps.strehl - strehl) <= 3.0 * maps.strehl_error
    lit = np.isfinite(maps.opd.values)
    x, y = np.meshgrid(maps.x, maps.y)
    centres = pupil.center + x[lit][:, None] * pupil.axes[0] + y[lit][:, None] * pupil.axes[1]
    off = maps.opd.values[lit] - air.paths(centres, look)
    assert np.sqrt(np.average(off**2, weights=maps.weight.values[lit])) <= 3.0 * maps.error
