"""Synthetic schlieren pictures of a field, as a bench with a knife edge would show.

Parallel light crosses the field, deflected by the angle e = (e_right, e_up) = integral of grad_perp(n) / n_0 ds. The
bench images the source, of height h, onto a knife edge with a lens of focal length f; the edge holds back the fraction
`cut_off` of it. A ray deflected by e moves its source image by f e, and the edge passes more or less of it:

    I / I_open = (1 - cut_off) + (f / h) e_cut,    cut to 0 .. 1

e_cut is the component across the edge: a "vertical" edge sees e_right, a "horizontal" one e_up, an edge at any angle
e_right cos a + e_up sin a. f / h is the `sensitivity` [1/rad]. Rays are traced with bending (see `line_of_sight.py`).

Reference: G. S. Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), sections 2.3 and 3.2.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.medium import IndexField

from ..display.shown import ROUNDING, shown
from ..inputs.arguments import checked
from .bench import Bench
from .line_of_sight import LineOfSight, check_exposure, check_turn, line_of_sight
from .picture import traced_dataset
from .picture_error import OF_CORNERS, SomeLight, error_of, light_on_squares
from .shadowgraph import spread
from .source_light import SourceLight
from .view import TracedPicture

if TYPE_CHECKING:
    import xarray

# Direction in which a deflection brightens the picture, from right toward up [rad].
_BRIGHT_DIRECTION = {"vertical": 0.0, "horizontal": 0.5 * math.pi}


@shown
@dataclass(frozen=True, eq=False)
class SchlierenImage(TracedPicture):
    """A schlieren picture, rows from the lowest up, with the data that it was made from.

    Attributes:
        intensity: light that passes the edge times the exposure, 1 for white, 0 behind the body; shape (ny, nx).
        horizontal: pixel centres along `right` [m], shape (nx,); z where the view is along x.
        vertical: pixel centres along `up` [m], shape (ny,); y where the view is along x.
        deflection: deflections toward right and up [rad], shape (ny, nx, 2); NaN where no ray came through.
        opd: optical path difference against the ambient medium [m], shape (ny, nx); NaN where no ray came through.
        blocked: pixels that the body hides, shape (ny, nx).
        right: direction of the picture's horizontal axis, shape (3,).
        up: direction of its vertical axis, shape (3,).
        knife_edge: "vertical", "horizontal", or the angle of the direction that brightens [rad].
        cut_off: fraction of the undisturbed source image that the edge holds back.
        sensitivity: change of light per deflection [1/rad].
        exposure: brightness of full light, 1 for white.
        known: pixels whose light is known, shape (ny, nx): see `LineOfSight.known`; None for all.
        measure_error: function of the brightness without sensor noise that returns its error; `error` calls it.
    """

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray
    deflection: np.ndarray
    opd: np.ndarray
    blocked: np.ndarray
    right: np.ndarray
    up: np.ndarray
    knife_edge: str | float
    cut_off: float
    sensitivity: float
    exposure: float = 1.0
    known: np.ndarray | None = None
    measure_error: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    def to_xarray(self) -> "xarray.Dataset":
        """Return the picture as a dataset with units."""
        return traced_dataset(
            self,
            {
                "deflection": ("pixel direction", self.deflection, "rad", "deflection of the light"),
                "opd": ("pixel", self.opd, "m", "optical path difference against the ambient medium"),
            },
            {
                "kind": "schlieren",
                "knife_edge": self.knife_edge,
                "cut_off": self.cut_off,
                "sensitivity_per_rad": self.sensitivity,
            },
        )


@checked
def schlieren(
    field: IndexField,
    *,
    knife_edge: str | float = "vertical",
    cut_off: float = 0.5,
    sensitivity: float | None = None,
    exposure: float = 1.0,
    bench: Bench | None = None,
    **options: Any,
) -> SchlierenImage:
    """Make a schlieren picture of a field.

    Args:
        field: any field; a planar one needs `width` and a view along x.
        knife_edge: "vertical" shows changes along the picture's horizontal, "horizontal" those along its vertical; or
            the direction in which a deflection brightens, as an angle from the picture's right toward its up [rad]: the
            edge is across that direction, and pi is a vertical edge inserted from the other side.
        cut_off: fraction of the undisturbed source image that the edge holds back, 0 to 1.
        sensitivity: f / h [1/rad]; None takes the value at which the largest 0.5 % of the deflections saturate.
        exposure: brightness of full light; above 1 / (1 - cut_off) the undisturbed picture is white.
        bench: the bench's optics: source, focal length (which together give the sensitivity), plane in focus, sensor.
        **options: view, extent, pixel_count, rays_per_pixel, width, tolerance, wavelength, backend, device, precision:
            as in `line_of_sight`.

    Raises:
        ValueError: an argument is out of range; the message names it and the remedy.
    """
    bright = check_knife_edge(knife_edge, cut_off, sensitivity, exposure)
    if bench is not None:
        if sensitivity is not None:
            raise ValueError(f"sensitivity = {sensitivity}: the bench's source and focal length give it; leave it out")
        return _by_bench(field, bench, knife_edge, bright, cut_off, exposure, options)
    return knife_edge_picture(
        line_of_sight(field, **options),
        knife_edge=knife_edge,
        cut_off=cut_off,
        sensitivity=sensitivity,
        exposure=exposure,
    )


@checked
def knife_edge_picture(
    traced: LineOfSight,
    *,
    knife_edge: str | float = "vertical",
    cut_off: float = 0.5,
    sensitivity: float | None = None,
    exposure: float = 1.0,
) -> SchlierenImage:
    """Make the schlieren picture of traced light; arguments and errors as in `schlieren`."""
    bright = check_knife_edge(knife_edge, cut_off, sensitivity, exposure)
    cut = _across(traced.deflection, bright)
    if sensitivity is None:
        sensitivity = _full_range_sensitivity(cut[traced.through], cut_off)
    edge: dict[str, Any] = {"bright": bright, "cut_off": cut_off, "sensitivity": sensitivity}
    light = np.where(traced.through, _open_share(traced.deflection, **edge), 0.0)
    brightness = np.clip(exposure * traced.pixel_mean(light), 0.0, 1.0)
    return SchlierenImage(
        intensity=brightness,
        deflection=traced.pixel_mean(traced.deflection),
        opd=traced.pixel_mean(traced.opd),
        **traced.frame,
        knife_edge=knife_edge,
        cut_off=float(cut_off),
        sensitivity=float(sensitivity),
        exposure=float(exposure),
        measure_error=error_of(brightness, traced, partial(_of_pixels, **edge, exposure=exposure)),
    )


def _open_share(deflection: np.ndarray, bright: float, cut_off: float, sensitivity: float) -> np.ndarray:
    """Return the share of light that passes the edge, of deflections toward right and up (..., 2)."""
    return np.clip(1.0 - cut_off + sensitivity * _across(deflection, bright), 0.0, 1.0)


def _of_pixels(some: SomeLight, bright: float, cut_off: float, sensitivity: float, exposure: float) -> np.ndarray:
    """Return the brightness of some pixels."""
    return np.clip(exposure * _open_share(some.deflection, bright, cut_off, sensitivity).mean(axis=1), 0.0, 1.0)


def _by_bench(
    field: IndexField,
    bench: Bench,
    knife_edge: str | float,
    bright: float,
    cut_off: float,
    exposure: float,
    options: dict[str, Any],
) -> SchlierenImage:
    """Make the picture of a bench; deflection and optical path are those of its source's middlemost point."""
    points = bench.points()[0]
    turned = np.array([[math.cos(bright), math.sin(bright)], [-math.sin(bright), math.cos(bright)]])
    traced = SourceLight(field, points @ turned, bench.focus, options)
    light = exposure * _bench_light(traced, bench, bright, cut_off)
    middle = traced.middle
    assert middle is not None
    brightness = np.clip(light, 0.0, 1.0)
    return SchlierenImage(
        intensity=brightness if bench.sensor is None else np.clip(bench.sensor.expose(light, bench.seed), 0.0, 1.0),
        deflection=middle.pixel_mean(middle.deflection),
        opd=middle.pixel_mean(middle.opd),
        **{**middle.frame, "known": traced.known},
        knife_edge=knife_edge,
        cut_off=float(cut_off),
        sensitivity=float(bench.sensitivity),
        exposure=float(exposure),
        measure_error=error_of(
            brightness,
            middle,
            partial(_of_bench, bench=bench, bright=bright, cut_off=cut_off, exposure=exposure),
            square=max(middle.window.pitch),
            curved=OF_CORNERS,
        ),
    )


def _bench_light(lights: Iterable[LineOfSight], bench: Bench, bright: float, cut_off: float) -> np.ndarray:
    """Return the light of a bench's pixels, from that of its source's points, shape (ny, nx)."""
    total = np.zeros(())
    for point, share, traced in zip(*bench.points(), lights, strict=True):
        passed = bench.passed(point, _across(traced.deflection, bright), cut_off)
        light = np.where(traced.through, passed, 0.0)
        if min(light.shape) < 2:
            raise ValueError(f"a bench's picture needs at least 2 x 2 rays, got {light.shape}: raise pixel_count")
        total = total + share * spread(traced, traced.displacement, np.nan_to_num(light))
    return total


def _of_bench(some: SomeLight, bench: Bench, bright: float, cut_off: float, exposure: float) -> np.ndarray:
    """Return the brightness of some pixels, the light of all of the source's points being deflected alike."""
    across = _across(some.deflection, bright)
    passed = sum(share * bench.passed(point, across, cut_off) for point, share in zip(*bench.points(), strict=True))
    return np.clip(exposure * light_on_squares(some, some.displacement, np.asarray(passed)), 0.0, 1.0)


def _across(deflection: np.ndarray, bright: float) -> np.ndarray:
    """Return the component of deflections toward `bright`; exact for the four directions along the axes."""
    quarter = bright / (0.5 * math.pi)
    if quarter == round(quarter):
        sign = 1.0 if round(quarter) % 4 < 2 else -1.0
        return sign * deflection[..., round(quarter) % 2]
    return math.cos(bright) * deflection[..., 0] + math.sin(bright) * deflection[..., 1]


def check_knife_edge(knife_edge: str | float, cut_off: float, sensitivity: float | None, exposure: float) -> float:
    """Check the arguments; return the direction that brightens [rad]."""
    known = isinstance(knife_edge, str) and knife_edge in _BRIGHT_DIRECTION
    if not known and (isinstance(knife_edge, (str, bool)) or not np.isfinite(knife_edge)):
        raise ValueError(f"knife_edge {knife_edge!r} is not known: choose 'vertical', 'horizontal' or an angle in rad")
    if not 0.0 <= cut_off <= 1.0:
        raise ValueError(f"cut_off = {cut_off}: give a fraction from 0 to 1")
    if sensitivity is not None and not np.isfinite(sensitivity):
        raise ValueError(f"sensitivity = {sensitivity}: give a finite number per radian, or None")
    check_exposure(exposure)
    return _BRIGHT_DIRECTION[knife_edge] if isinstance(knife_edge, str) else check_turn("knife_edge", knife_edge)


def _full_range_sensitivity(cut: np.ndarray, cut_off: float) -> float:
    """Return the sensitivity at which all but the largest deflections are within the edge's range; 0 if all are 0.

    Deflections below rounding count as 0, lest rounding fill the picture with stripes.
    """
    largest = float(np.quantile(np.abs(cut), 0.995)) if cut.size else 0.0
    room = min(cut_off, 1.0 - cut_off) or 1.0
    return room / largest if largest > ROUNDING["rad"] else 0.0
