"""Synthetic schlieren pictures of a field, as a bench with a knife edge would show.

    I / I_open = (1 - cut_off) + (f / h) e_cut,    cut to 0 .. 1,    e_cut the deflection across the edge

Reference: G. S. Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), sections 2.3 and 3.2.
"""

import math
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from typing import Any, ClassVar, cast, overload

import numpy as np

from ..display.shown import ROUNDING, shown
from ..flow.series import Series
from ..inputs.arguments import checked
from ..inputs.checks import DEFAULT_WAVELENGTH
from ..medium import IndexField
from .bench import Bench, light_of_source
from .line_of_sight import LineOfSight, check_exposure, check_turn, traced_light
from .picture import TracedPicture
from .picture_error import OF_CORNERS, SomeLight, light_on_squares, shared_attributes
from .shadowgraph import spread


@shown
@dataclass(frozen=True, eq=False, kw_only=True)
class SchlierenImage(TracedPicture):
    """A schlieren picture with the data that it was made from.

    Attributes:
        deflection: deflections toward right and up [rad], shape (ny, nx, 2); NaN where no ray came through.
        opd: optical path difference against the ambient medium [m], shape (ny, nx); NaN where no ray came through.
        knife_edge: "vertical", "horizontal", or the angle of the direction that brightens [rad].
        cut_off: fraction of the undisturbed source image that the edge holds back.
        sensitivity: change of light per deflection [1/rad].
    """

    deflection: np.ndarray
    opd: np.ndarray
    knife_edge: str | float
    cut_off: float
    sensitivity: float

    KIND: ClassVar[str] = "schlieren"
    MAPS: ClassVar[dict[str, tuple[str, str, str]]] = {
        "deflection": ("pixel direction", "rad", "deflection of the light"),
        "opd": ("pixel", "m", "optical path difference against the ambient medium"),
    }
    NUMBERS: ClassVar[dict[str, str]] = {
        "knife_edge": "knife_edge",
        "cut_off": "cut_off",
        "sensitivity_per_rad": "sensitivity",
    }


@dataclass(frozen=True)
class KnifeEdge:
    """A knife edge: the arguments of `schlieren` of these names."""

    knife_edge: str | float = "vertical"
    cut_off: float = 0.5
    sensitivity: float | None = None
    bench: Bench | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        edge = self.knife_edge
        if not (isinstance(edge, str) and edge in ("vertical", "horizontal")):
            if isinstance(edge, (str, bool)) or not np.isfinite(edge):
                raise ValueError(
                    f"knife_edge {edge!r} is not known: choose 'vertical', 'horizontal' or an angle in rad"
                )
            check_turn("knife_edge", edge)
        if not 0.0 <= self.cut_off <= 1.0:
            raise ValueError(f"cut_off = {self.cut_off}: give a fraction from 0 to 1")
        if self.sensitivity is not None and not np.isfinite(self.sensitivity):
            raise ValueError(f"sensitivity = {self.sensitivity}: give a finite number per radian, or None")

    @property
    def bright(self) -> float:
        """Direction in which a deflection brightens the picture, from right toward up [rad]."""
        edge = self.knife_edge
        return float(edge) if not isinstance(edge, str) else 0.0 if edge == "vertical" else 0.5 * math.pi

    def across(self, deflection: np.ndarray) -> np.ndarray:
        """Return the component of deflections (..., 2) toward `bright`; exact for directions along the axes."""
        quarter = self.bright / (0.5 * math.pi)
        if quarter == round(quarter):
            sign = 1.0 if round(quarter) % 4 < 2 else -1.0
            return sign * deflection[..., round(quarter) % 2]
        return math.cos(self.bright) * deflection[..., 0] + math.sin(self.bright) * deflection[..., 1]

    def passed(self, deflection: np.ndarray) -> np.ndarray:
        """Return the share of light that passes the edge, of deflections toward right and up (..., 2)."""
        assert self.sensitivity is not None
        return np.clip(1.0 - self.cut_off + self.sensitivity * self.across(deflection), 0.0, 1.0)

    def light_of(self, some: SomeLight) -> np.ndarray:
        """Return the light of some pixels, that of all of a bench's source's points being deflected alike."""
        if self.bench is None:
            return np.asarray(self.passed(some.deflection).mean(axis=1))
        across, passed = self.across(some.deflection), np.zeros(())
        for point, share in zip(*self.bench.points(), strict=True):
            passed = passed + share * self.bench.passed(point, across, self.cut_off)
        return light_on_squares(some, some.displacement, passed)

    def with_full_range(self, deflection: np.ndarray) -> "KnifeEdge":
        """Return the edge with the sensitivity at which all but the largest 0.5 % of deflections are within its range.

        It is 0 if all are 0. Deflections below rounding count as 0, lest rounding fill the picture with stripes.
        """
        largest = float(np.quantile(np.abs(self.across(deflection)), 0.995)) if deflection.size else 0.0
        room = min(self.cut_off, 1.0 - self.cut_off) or 1.0
        return replace(self, sensitivity=room / largest if largest > ROUNDING["rad"] else 0.0)


@shown
@dataclass(frozen=True, eq=False)
class SchlierenFilm:
    """Schlieren pictures of the snapshots of a series, all of one sensitivity.

    Attributes:
        time: Time of each frame [s], shape (n,).
        frames: The pictures, n of them, whose errors are not known: `schlieren` of a snapshot's index field has one's.
    """

    time: np.ndarray
    frames: tuple[SchlierenImage, ...] = attribute(repr=False)

    def to_xarray(self) -> Any:
        """Return the frames as one xarray.Dataset over time [s]: what `SchlierenImage.to_xarray` has of each."""
        import xarray

        time = xarray.IndexVariable("time", self.time, {"units": "s", "long_name": "time"})
        return xarray.concat([one.to_xarray() for one in self.frames], time, combine_attrs="override")


def _film(series: Series, edge: KnifeEdge, shared: dict[str, Any], options: dict[str, Any]) -> SchlierenFilm:
    """Return the film of a series, whose frames do not hold the fields of the snapshots."""
    fields = (one.index_field(wavelength=options.get("wavelength", DEFAULT_WAVELENGTH)) for one in series)
    if shared["bench"] is None:
        lights = [replace(traced_light(one, options), light=cast(Any, None)) for one in fields]
        if edge.sensitivity is None:
            edge = edge.with_full_range(np.concatenate([one.deflection[one.through] for one in lights]))
        made = (schlieren(one, sensitivity=edge.sensitivity, **shared) for one in lights)
    else:
        made = (schlieren(one, sensitivity=edge.sensitivity, **shared, **options) for one in fields)
    return SchlierenFilm(series.time, tuple(replace(one, measure_error=None) for one in made))


@overload
def schlieren(field: Series, **options: Any) -> SchlierenFilm: ...
@overload
def schlieren(field: IndexField | LineOfSight, **options: Any) -> SchlierenImage: ...
@checked
def schlieren(
    field: IndexField | LineOfSight | Series,
    *,
    knife_edge: str | float = "vertical",
    cut_off: float = 0.5,
    sensitivity: float | None = None,
    exposure: float = 1.0,
    bench: Bench | None = None,
    **options: Any,
) -> SchlierenImage | SchlierenFilm:
    """Make a schlieren picture of a field, or of each snapshot of a series: a film.

    Args:
        field: any field, of which a planar one needs `width` and a view along x; or light that was traced through one;
            or a Series, whose snapshots become index fields at `wavelength`, and whose frames share one sensitivity.
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
    edge = KnifeEdge(knife_edge, cut_off, sensitivity)
    check_exposure(exposure)
    if isinstance(field, Series):
        shared = {"knife_edge": knife_edge, "cut_off": cut_off, "exposure": exposure, "bench": bench}
        return _film(field, edge, shared, options)
    if bench is None:
        traced = traced_light(field, options)
        if edge.sensitivity is None:
            edge = edge.with_full_range(traced.deflection[traced.through])
        light = traced.pixel_mean(np.where(traced.through, edge.passed(traced.deflection), 0.0))
        return _finished(edge, traced, light, exposure)
    if sensitivity is not None:
        raise ValueError(f"sensitivity = {sensitivity}: the bench's source and focal length give it; leave it out")
    edge = replace(edge, sensitivity=bench.sensitivity, bench=bench)

    def light_of(traced: LineOfSight, point: np.ndarray) -> np.ndarray:
        light = np.where(traced.through, bench.passed(point, edge.across(traced.deflection), cut_off), 0.0)
        if min(light.shape) < 2:
            raise ValueError(f"a bench's picture needs at least 2 x 2 rays, got {light.shape}: raise pixel_count")
        return spread(traced, traced.displacement, np.nan_to_num(light))

    light, middle, known = light_of_source(field, bench, edge.bright, light_of, options)
    of_error = {"square": max(middle.window.pitch), "curved": OF_CORNERS}
    return _finished(edge, middle, light, exposure, bench=bench, known=known, **of_error)


def _finished(
    edge: KnifeEdge, traced: LineOfSight, light: np.ndarray, exposure: float, **shared: Any
) -> SchlierenImage:
    assert edge.sensitivity is not None
    return SchlierenImage(
        deflection=traced.pixel_mean(traced.deflection),
        opd=traced.pixel_mean(traced.opd),
        knife_edge=edge.knife_edge,
        cut_off=float(edge.cut_off),
        sensitivity=float(edge.sensitivity),
        **shared_attributes(edge, traced, light, exposure, **shared),
    )
