"""Parallel light traced once through a field, from which schlieren, shadowgraph and interferogram are made.

A ray seems to come from where its exit line meets the plane in focus, L ahead of the exit, with the phase that it has
there: opd - n_0 L (1 / cos(d, forward) - 1). Reference: C. M. Vest, Holographic Interferometry (Wiley, 1979), 6.3.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_count, warn_caller
from ..medium import IndexField
from ..pupils.base import as_unit_vector
from ..rays import RayBundle
from ..tracing import Plane, RayStatus, trace
from ..tracing.cuts import lost
from ..tracing.lines import box_size
from ..tracing.pupil.air import GREATEST_SHARE
from ..tracing.variants.paths import Rays

GREATEST_RAY_COUNT = 100_000_000  # some 20 GB of stored results


AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class Window:
    """Viewing direction, pixels and extent of a picture of a field."""

    forward: np.ndarray  # direction of the light, shape (3,)
    right: np.ndarray  # direction of the picture's horizontal axis, shape (3,)
    up: np.ndarray  # direction of its vertical axis, shape (3,)
    horizontal: np.ndarray  # pixel centres along `right` [m], shape (nx,)
    vertical: np.ndarray  # pixel centres along `up` [m], shape (ny,)
    pitch: tuple[float, float]  # width and height of a pixel [m]
    entry: float  # coordinate along `forward` at which rays start [m]
    exit: float  # coordinate along `forward` at which they have left the field [m]

    @property
    def middle(self) -> float:
        """Coordinate along `forward` of the field's middle [m]."""
        return 0.5 * (self.entry + self.exit)


def ray_lines(window: Window, rays_per_pixel: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of k rays per pixel along right, shape (nx k,), and along up, shape (ny k,) [m]."""
    offset = (np.arange(rays_per_pixel) - 0.5 * (rays_per_pixel - 1)) / rays_per_pixel
    right, up = (
        (centres[:, None] + pitch * offset).ravel()
        for centres, pitch in zip((window.horizontal, window.vertical), window.pitch, strict=True)
    )
    return right, up


def _view_axes(view) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return forward, right and up as seen along the light with y up (x up for light along y)."""
    if isinstance(view, str) and view not in AXES:
        raise ValueError(f"view {view!r} is not known: choose 'x', 'y', 'z' or three numbers")
    forward = as_unit_vector(AXES[view] if isinstance(view, str) else view, "view")
    upright = np.array(AXES["y"] if abs(forward[1]) < 0.99 else AXES["x"])
    right = np.cross(forward, upright)
    right /= np.linalg.norm(right)
    return forward, right, np.cross(right, forward)


def _finite_box(field: IndexField, forward: np.ndarray, width: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the field's box; a planar field is cut to `width` along x, and light must be along x."""
    low, high = field.box
    if field.geometry != "planar":
        if width is not None:
            raise ValueError(f"width = {width}: {field.geometry} fields have their own; leave it out")
        return low, high
    if width is None or not (np.isfinite(width) and width > 0.0):
        raise ValueError(f"width = {width}: a planar field is infinite in x; give the length of the light's path [m]")
    if abs(forward[0]) < 1.0 - 1e-12:
        raise ValueError(
            f"view {forward.tolist()}: look through a planar field along x, the axis along which it is constant"
        )
    return np.array([-0.5 * width, *low[1:]]), np.array([0.5 * width, *high[1:]])


def _span(low: np.ndarray, high: np.ndarray, axis: np.ndarray) -> tuple[float, float]:
    """Return the least and greatest coordinate of a box along `axis` [m]."""
    ends = np.stack([low * axis, high * axis])
    return float(ends.min(axis=0).sum()), float(ends.max(axis=0).sum())


def _pixels(low, high, right, up, extent, pixel_count) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Return pixel centres along right and up [m], and the size of a pixel."""
    if extent is None:
        extent = (*_span(low, high, right), *_span(low, high, up))
    if len(extent) != 4 or not np.isfinite(extent).all() or extent[0] >= extent[1] or extent[2] >= extent[3]:
        raise ValueError(f"extent {extent!r}: give (right from, right to, up from, up to) in metres, increasing")
    size = np.array([extent[1] - extent[0], extent[3] - extent[2]])
    counts = np.asarray(pixel_count)
    if counts.dtype.kind not in "iu" or counts.shape not in ((), (2,)) or (counts < 1).any():
        raise ValueError(f"pixel_count {pixel_count!r}: give one whole number of at least 1, or two")
    if counts.shape == ():
        counts = np.maximum(1, np.rint(counts * size / size.max())).astype(int)
    spans = np.array([np.ptp(_span(low, high, axis)) for axis in (right, up)])
    if (size > counts * spans).any():
        raise ValueError(
            f"extent {extent!r} has pixels of {size[0] / counts[0]:.3g} by {size[1] / counts[1]:.3g} m, the field "
            f"is {spans[0]:.3g} by {spans[1]:.3g} m: give metres, or more pixels"
        )
    step = size / counts
    horizontal, vertical = (extent[2 * k] + (np.arange(counts[k]) + 0.5) * step[k] for k in range(2))
    return horizontal, vertical, (float(step[0]), float(step[1]))


@dataclass(frozen=True, eq=False)
class LineOfSight:
    """Parallel light through a field, k x k rays per pixel; arrays over rays have shape (ny k, nx k).

    Attributes:
        window: directions of the view and the pixels.
        rays_per_pixel: k, rays along each side of a pixel.
        deflection: deflections toward right and up [rad], shape (ny k, nx k, 2); NaN where no ray came through.
        opd: optical path difference against the ambient medium, seen in the focal plane [m]; NaN as above.
        displacement: displacement of the virtual ray in the focal plane, toward right and up [m], shape (ny k, nx k,
            2); NaN as above.
        through: rays that came through.
        blocked: rays that met the body.
        wavelength: vacuum wavelength [m].
        focus: coordinate of the focal plane along the light [m].
        doubtful: rays that failed, or lack more than the tolerance by cuts through disturbed air.
        light: the light that was traced, to trace it again for the error of a picture.
    """

    window: Window
    rays_per_pixel: int
    deflection: np.ndarray
    opd: np.ndarray
    displacement: np.ndarray
    through: np.ndarray
    blocked: np.ndarray
    wavelength: float
    focus: float
    doubtful: np.ndarray
    light: "ParallelLight"

    @property
    def ray_grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Undisturbed positions of the rays along right and up [m], each of shape (ny k, nx k)."""
        across, along = np.meshgrid(*ray_lines(self.window, self.rays_per_pixel))
        return across, along

    def pixel_mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean over the rays of each pixel that are not NaN, shape (ny, nx) or (ny, nx, m)."""
        k = self.rays_per_pixel
        ny, nx = len(self.window.vertical), len(self.window.horizontal)
        blocks = values.reshape(ny, k, nx, k, *values.shape[2:])
        good = np.isfinite(blocks)
        total, count = np.where(good, blocks, 0.0).sum(axis=(1, 3)), good.sum(axis=(1, 3))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    @property
    def known(self) -> np.ndarray:
        """Mask of the pixels whose light is known: at most a thousandth of their rays is doubtful, shape (ny, nx)."""
        return np.asarray(self.pixel_mean(self.doubtful.astype(np.float64)) <= GREATEST_SHARE)


@dataclass(frozen=True, eq=False)
class ParallelLight:
    """Parallel light before it is traced: everything that a `LineOfSight` is computed from."""

    field: IndexField
    window: Window  # directions of the view and the pixels
    rays_per_pixel: int  # k, rays along each side of a pixel
    focus: float  # coordinate of the focal plane along the light [m]
    sine: np.ndarray  # angles of the light toward right and up, as direction sines, shape (2,)
    options: dict[str, Any]  # tolerance, wavelength, backend, device and precision of `trace`

    @property
    def until(self) -> Plane:
        """The plane behind the field on which the rays stop."""
        return Plane(self.window.exit * self.window.forward, self.window.forward)

    @property
    def ahead(self) -> np.ndarray:
        """Displacements of undisturbed rays toward right and up from their start to the focal plane [m], (2,)."""
        return np.asarray((self.focus - self.window.entry) * self._tangent)

    @property
    def _tangent(self) -> np.ndarray:
        return np.asarray(self.sine / np.sqrt(1.0 - self.sine @ self.sine))

    def rays(self, across: np.ndarray, along: np.ndarray) -> RayBundle:
        """Return the rays whose undisturbed places in the focal plane are given toward right and up [m], row by row."""
        window, tangent = self.window, self._tangent
        light = window.forward + tangent[0] * window.right + tangent[1] * window.up
        return RayBundle(self._start(across, along).reshape(-1, 3), np.broadcast_to(light, (across.size, 3)))

    def _start(self, across: np.ndarray, along: np.ndarray) -> np.ndarray:
        window, ahead = self.window, self.ahead
        right, up = (across[..., None] - ahead[0]) * window.right, (along[..., None] - ahead[1]) * window.up
        return np.asarray(right + up + window.entry * window.forward)

    def seen(self, across: np.ndarray, along: np.ndarray, brought: Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what a camera sees of rays through undisturbed places toward right and up [m].

        Deflections [rad] and displacements in the focal plane [m], of shape (*across.shape, 2), and optical path
        differences there [m].
        """
        window, sine, shape, back = self.window, self.sine, across.shape, self.window.exit - self.focus
        direction = brought.direction.reshape(*shape, 3)
        sines = np.stack([direction @ window.right, direction @ window.up], axis=-1)
        deflection = sines - sine
        # 1 / cos - 1 / cos_0 = (sin^2 - sin_0^2) / (cos cos_0 (cos + cos_0)): avoids a difference of nearly equal
        # numbers
        cosine, straight = direction @ window.forward, float(np.sqrt(1.0 - sine @ sine))
        stretch = np.sum(deflection * (sines + sine), axis=-1) / (cosine * straight * (straight + cosine))
        moved = brought.position.reshape(*shape, 3) - self._start(across, along)
        moved = np.stack([moved @ window.right, moved @ window.up], axis=-1)
        displacement = moved - self.ahead - back * sines / cosine[..., None]
        opd = brought.opd.reshape(shape) - self.field.ambient_index * (back * stretch + displacement @ sine)
        return deflection, displacement, opd

    def trace(self) -> LineOfSight:
        """Trace the light."""
        field, window = self.field, self.window
        across, along = np.meshgrid(*ray_lines(window, self.rays_per_pixel))
        row_count = len(along)
        # Of a body of revolution seen from the side, with its axis in the middle, only the upper half is traced; the
        # lower one is its mirror image.
        heights, sideways = along[:, 0], abs(abs(float(window.right[2])) - 1.0) < 1e-12
        even = np.abs(heights + heights[::-1]).max() <= 1e-9 * np.abs(heights).max()
        symmetric = field.geometry == "axisymmetric" and sideways and even and not self.sine.any()
        if symmetric:
            across, along = across[row_count // 2 :], along[row_count // 2 :]
        rays, shape = self.rays(across, along), across.shape
        traced = trace(field, rays, until=self.until, outputs=("position", "direction", "opd"), **self.options)
        assert traced.direction is not None and traced.opd is not None and traced.position is not None  # requested
        brought = Rays(traced.opd, traced.direction, traced.position)
        deflection, displacement, opd = self.seen(across, along, brought)
        blocked = traced.traced_status == RayStatus.HIT_BODY
        if field.body is not None and field.geometry == "planar":  # light along the axis never meets the body's side
            blocked |= field.body.contains(field.local_coordinates(rays.position))
        through = (traced.ok & ~blocked).reshape(shape)
        # Real light comes from far away and goes on: what is before the rays' start and behind their stop counts too.
        before = RayBundle(rays.position - box_size(field) * rays.direction, rays.direction)
        tolerance = self.options["tolerance"] * traced.wavelength
        amount = lost(field, before, None, tolerance=tolerance)
        doubtful = ~blocked & (~traced.ok | (np.abs(amount) > tolerance))

        def whole(values: np.ndarray) -> np.ndarray:
            if not symmetric:
                return values
            lower = values[::-1][: row_count // 2]
            return np.concatenate([lower * np.array([1.0, -1.0]) if values.ndim == 3 else lower, values])

        def seen(values: np.ndarray) -> np.ndarray:
            return whole(np.where(through.reshape(through.shape + (1,) * (values.ndim - 2)), values, np.nan))

        return LineOfSight(
            window=window,
            rays_per_pixel=self.rays_per_pixel,
            deflection=seen(deflection),
            opd=seen(opd),
            displacement=seen(displacement),
            through=whole(through),
            blocked=whole(blocked.reshape(shape)),
            wavelength=traced.wavelength,
            focus=self.focus,
            doubtful=whole(doubtful.reshape(shape)),
            light=self,
        )


@checked
def line_of_sight(
    field: IndexField,
    *,
    view="x",
    extent: tuple[float, float, float, float] | None = None,
    pixel_count: int | tuple[int, int] = 256,
    rays_per_pixel: int = 1,
    width: float | None = None,
    tolerance: float = 1e-3,
    wavelength: float | None = None,
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
    focus: float = 0.0,
    tilt: tuple[float, float] = (0.0, 0.0),
) -> LineOfSight:
    """Trace parallel light through a field.

    Args:
        field: any field; a planar one needs `width` and a view along x.
        view: direction of the light, "x", "y", "z" or three numbers.
        extent: right from, to, up from, to [m]; None takes in the field's box.
        pixel_count: pixels along right and up, or along the longer side of square pixels.
        rays_per_pixel: k: each pixel is the mean over k x k rays.
        width: length of the light's path through a planar field [m].
        tolerance: requested OPD error of the tracer [waves].
        wavelength: vacuum wavelength [m]; None takes the field's own, or 905 nm if it has none.
        backend: as in `trace`.
        device: as in `trace`.
        precision: as in `trace`.
        focus: the plane in focus, along the light from the middle of the field [m].
        tilt: angles of the light toward right and up, as direction sines, for an off-axis point of the source [rad].

    Raises:
        ValueError: an argument is out of range; the message names it and the remedy.

    Warns:
        RuntimeWarning: some pixels look through disturbed air that ends with the field's box; `known` marks them.
    """
    sine = np.asarray(tilt, dtype=np.float64)
    if sine.shape != (2,) or not np.isfinite(sine).all() or np.abs(sine).max() > 0.5:
        raise ValueError(f"tilt {tilt!r}: give two angles of at most 0.5 rad")
    if not np.isfinite(focus):
        raise ValueError(f"focus = {focus}: give the position of the plane in focus in metres from the field's middle")
    check_count(rays_per_pixel, "rays_per_pixel")
    forward, right, up = _view_axes(view)
    low, high = _finite_box(field, forward, width)
    horizontal, vertical, pitch = _pixels(low, high, right, up, extent, pixel_count)
    entry, exit_ = _span(low, high, forward)
    if field.geometry != "planar":  # rounding would decide whether rays meet a plane on a face of the box
        entry, exit_ = entry - 0.005 * (exit_ - entry), exit_ + 0.005 * (exit_ - entry)
    window = Window(forward, right, up, horizontal, vertical, pitch, entry, exit_)
    ray_count = len(window.horizontal) * len(window.vertical) * rays_per_pixel**2
    if ray_count > GREATEST_RAY_COUNT:
        raise ValueError(
            f"{len(window.horizontal)} x {len(window.vertical)} pixels of {rays_per_pixel}^2 rays are {ray_count:.1e} "
            f"rays, more than {GREATEST_RAY_COUNT:.0e}: take a smaller pixel_count or rays_per_pixel"
        )
    options = {
        "tolerance": tolerance,
        "wavelength": wavelength,
        "backend": backend,
        "device": device,
        "precision": precision,
    }
    result = ParallelLight(field, window, int(rays_per_pixel), window.middle + float(focus), sine, options).trace()
    if not result.known.all():
        warn_caller(
            f"of {100.0 * float(np.mean(~result.known)):.3g} % of the picture's pixels the light is not known: their "
            "rays leave the field by a cut through disturbed air, or fail; those pixels are marked in `known`",
            RuntimeWarning,
        )
    return result


def traced_light(field: IndexField | LineOfSight, options: dict[str, Any]) -> LineOfSight:
    """Trace light through a field with options of `line_of_sight`; light that was traced before is taken as it is."""
    if not isinstance(field, LineOfSight):
        return line_of_sight(field, **options)
    if options:
        raise TypeError(f"{next(iter(options))} is an option of line_of_sight, and this light was traced before")
    return field


def check_exposure(exposure: float) -> float:
    """Check that an exposure is positive and finite."""
    if not (np.isfinite(exposure) and exposure > 0.0):
        raise ValueError(f"exposure = {exposure}: give a positive number; 1 shows full light as white")
    return float(exposure)


def check_turn(name: str, angle: float) -> float:
    """Check that an angle [rad] is finite and at most one turn: more are most likely degrees."""
    if not (np.isfinite(angle) and abs(angle) <= 2.0 * np.pi * (1.0 + 1e-9)):
        raise ValueError(f"{name} = {angle}: give an angle in radians of at most one turn, 2 pi; is it in degrees?")
    return float(angle)
