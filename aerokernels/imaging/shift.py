"""Displacement of a camera's picture by a flow, from rays of points of its aperture.

    shift = mean (L - L0) / scene_pixel,      picture with the flow (pixel) = picture without it (pixel + shift)

A pixel's ray meets the scene at L with the flow and at L0 without it; for a far scene, tangents replace L / D.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ..display.shown import drawn_on, is_flat, say_flat
from ..inputs.arguments import checked
from ..inputs.checks import check_positive, warn_caller
from ..inputs.kinds import wrong_kind
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..rays import RayBundle
from ..sensor import Sensor
from ..tracing import trace
from ..tracing.cuts import lost, may_lose
from ..tracing.plan import TraceOptions, complete
from ..tracing.pupil.air import GREATEST_SHARE
from ..tracing.some_pixels import SomePixels, total
from ..tracing.stop import plane_beyond, reached
from ..tracing.variants.paths import Rays
from .camera import Aperture, Camera, rows_and_columns

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

# Points of the aperture: a ring of four gives the exact mean of polynomials up to the third order.
APERTURE_RAYS = 4
# (point of the aperture [m], its share of the light, shifts [pixels] of shape (rows, columns, 2), mask of the rays that
# arrived)
Visit = Callable[[np.ndarray, float, np.ndarray, np.ndarray], None]


# Most points of the aperture whose rays change.
MOST_POINTS = 16


@dataclass(frozen=True, eq=False)
class KnownView:
    """A camera in front of a field: finds the pixels that look through disturbed air that was cut off the field."""

    field: IndexField
    camera: Camera
    aperture: Aperture
    tolerance: float  # greatest OPD that a ray may lose by cuts [m]
    options: dict[str, Any]  # of `trace`

    def truncated(self, shape: tuple[int, int], stride: tuple[int, int] = (1, 1)) -> np.ndarray:
        """Return the share of the aperture that loses more than the tolerance, for every `stride`-th pixel."""
        x, y = (axis[step // 2 :: step] for axis, step in zip(self.camera.tangents(shape), stride[::-1], strict=True))
        found = np.zeros((len(y), len(x)))
        if not may_lose(self.field, self.tolerance):
            return found
        across, up = (axis.ravel() for axis in np.meshgrid(x, y))
        for point, weight in zip(self.aperture.points, self.aperture.weights, strict=True):
            rays = self.camera.rays(point, across, up)
            amount = lost(self.field, rays, self.camera.scene_plane, tolerance=self.tolerance)
            found.ravel()[np.abs(amount) > self.tolerance] += weight
        return found

    def check(self, shape: tuple[int, int], allowed: bool) -> None:
        """Check that at most a thousandth of a view is truncated, unless more is allowed; warn of less."""
        if allowed:
            return
        stride = tuple(max(1, count // 32) for count in shape)
        share = self.truncated(shape, (stride[0], stride[1]))
        concerned = 100.0 * float(np.mean(share > GREATEST_SHARE))
        if concerned == 0.0:
            return
        text = f"{concerned:.3g} % of the picture looks through disturbed air that was cut off the field"
        if float(np.mean(share)) <= GREATEST_SHARE:
            warn_caller(f"{text}; those pixels are marked in `known`", RuntimeWarning)
            return
        raise ValueError(
            f"{text}. Give the field a larger region there, look another way, or take allow_truncation=True and read "
            "`known`, where those pixels are marked"
        )


class PixelErrors:
    """Errors of the maps of a camera's view."""

    def __init__(self, view: KnownView, shape: tuple[int, int]):
        """Trace rays of some pixels of a shape through points of the view's aperture."""
        self.view, self.camera, self.own = view, view.camera, view.aperture
        self.few, count = self.own, len(self.own.points)
        if count > MOST_POINTS:  # some are drawn by their shares of the light
            chosen = np.random.default_rng(0).choice(count, MOST_POINTS, replace=False, p=self.own.weights)
            self.few = Aperture(self.own.points[chosen], np.full(MOST_POINTS, 1.0 / MOST_POINTS))
        self.pixels = SomePixels(shape, len(self.few.points))
        rays = self._rays(self.few, self.pixels.place)
        self.pixels.trace(view.field, rays, self.camera.scene_plane, view.options)

    def of(self, number: Callable[[Aperture, np.ndarray], np.ndarray], stored: np.ndarray, other: Aperture | None):
        """Return the errors of a number of shifts of some pixels, which is `stored` (rows, columns, 2), of its shape.

        `other` points of the aperture tell what their number leaves out; None for no cause "sampling".
        """
        pixels = self.pixels
        if pixels.found is None:
            return np.full(stored.shape, np.nan)
        place = pixels.place[pixels.kept]
        errors = pixels.errors(
            lambda rays: number(self.few, self._shifts(self.few, place, rays)),
            stored if self.few is self.own else None,
        )
        if other is not None:
            tried = np.arange(len(place))[:64]
            rays = self._rays(other, place[tried])
            outputs, plane = ("position", "direction"), self.camera.scene_plane
            traced = trace(self.view.field, rays, until=plane, outputs=outputs, **self.view.options)
            assert traced.direction is not None and traced.position is not None  # requested
            ends = Rays(np.zeros(rays.ray_count), traced.direction, traced.position)
            at = place[tried]
            change = number(other, self._shifts(other, at, ends)) - stored[at[:, 0], at[:, 1]]
            errors["sampling"] = pixels.spread(change)
        return pixels.whole_map(total(errors))

    def _tangents(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = self.camera.tangents(self.pixels.shape)
        return x[place[:, 1]], y[place[:, 0]]

    def _rays(self, aperture: Aperture, place: np.ndarray) -> RayBundle:
        """Return the rays of all points of the aperture for each pixel at rows and columns (m, 2)."""
        each = [self.camera.rays(point, *self._tangents(place)) for point in aperture.points]
        position, direction = (
            np.stack([getattr(one, name) for one in each], axis=1).reshape(-1, 3) for name in ("position", "direction")
        )
        return RayBundle.of_units(position, direction)

    def _shifts(self, aperture: Aperture, place: np.ndarray, rays: Rays) -> np.ndarray:
        """Return the shifts of the rays [pixels], shape (m, n, 2)."""
        count = len(aperture.points)
        x, y = (np.repeat(tangent, count) for tangent in self._tangents(place))
        ends = rays.position if np.isfinite(self.camera.distance) else rays.direction
        shifts = self.camera.shift(ends, np.tile(aperture.points, (len(place), 1)), x, y)
        return shifts.reshape(len(place), count, 2)


@dataclass(frozen=True, eq=False, repr=False)
class BackgroundDisplacement:
    """Displacement of a camera's picture by a flow, pixel by pixel.

    Attributes:
        displacement: Displacement of the picture's content by the flow, along x and y [pixels], at the pixel where it
            is seen through the flow, shape (rows, columns, 2); NaN where nothing is seen.
        blur: Root mean square distance of the aperture's rays from their mean in the scene, without the spread by depth
            of field alone, along x and y [pixels], shape (rows, columns, 2).
        through: Share of the aperture whose rays reach the scene, shape (rows, columns).
        camera: The camera.
        wavelength: Vacuum wavelength [m].
        plan: How the rays of one point of the aperture were traced.
        seconds: Wall time by stage: see STAGES in clock.py.
        view: The view, for `truncated` and `error`, which are computed when first read.
    """

    displacement: np.ndarray
    blur: np.ndarray
    through: np.ndarray
    camera: Camera
    wavelength: float
    plan: Any = None
    seconds: dict[str, float] = field(default_factory=dict)
    view: KnownView | None = None

    @cached_property
    def error(self) -> np.ndarray:
        """Error of the size of the displacement [pixels], shape (rows, columns); NaN if it is not known.

        It is the displacement of some pixels computed again with their rays changed by each cause, and with another
        number of points of the aperture. Computed when first read.
        """
        if self.pixel_errors is None or self.view is None:
            return np.full(self.through.shape, np.nan)
        count = len(self.view.aperture.points)
        other = None if count == 1 else self.camera.aperture(_others(count, 16))
        return np.linalg.norm(self.pixel_errors.of(Aperture.mean, self.displacement, other), axis=-1)

    @cached_property
    def blur_error(self) -> np.ndarray:
        """Error of the blur along x and y [pixels], shape (rows, columns, 2), as `error`; NaN if it is not known."""
        if self.pixel_errors is None or self.view is None:
            return np.full(self.blur.shape, np.nan)
        other = self.camera.aperture(_others(len(self.view.aperture.points), 36))
        return self.pixel_errors.of(Aperture.blur, self.blur, other)

    @cached_property
    def pixel_errors(self) -> PixelErrors | None:
        """Rays of some pixels and how they change by each cause; None for a displacement without a view."""
        if self.view is None:
            return None
        return PixelErrors(self.view, self.through.shape)

    @cached_property
    def truncated(self) -> np.ndarray:
        """Share of each pixel's aperture that looks through disturbed air that was cut off the field.

        Shape (rows, columns). In those pixels the displacement is due to the rest alone. Computed when first read,
        along straight lines.
        """
        shape = self.through.shape
        return np.zeros(shape) if self.view is None else self.view.truncated(shape)

    @property
    def known(self) -> np.ndarray:
        """Mask of the pixels of which at most a thousandth of the aperture is truncated."""
        return self.truncated <= GREATEST_SHARE

    @property
    def shift(self) -> np.ndarray:
        """Scene position seen by a pixel minus the one without the flow [pixels]: minus the displacement."""
        return -self.displacement

    @property
    def angle(self) -> np.ndarray:
        """The displacement as the angle seen from the camera [rad], shape (rows, columns, 2)."""
        return self.displacement * self.camera.pixel_tangent

    @property
    def scene_displacement(self) -> np.ndarray:
        """The displacement in the plane of the scene [m], shape (rows, columns, 2)."""
        return self.displacement * self.camera.scene_pixel

    def to_xarray(self) -> "xarray.Dataset":
        """Return the maps as a dataset with units over (y, x)."""
        import xarray

        pair, one = ("y", "x", "component"), ("y", "x")
        rows, columns = self.through.shape
        maps = {
            "displacement": (pair, "pixel", "displacement through the flow"),
            "blur": (pair, "pixel", "rms spread of the aperture's rays"),
            "through": (one, "1", "share of the aperture that sees the scene"),
            "truncated": (one, "1", "share of the aperture that looks through air that was cut off"),
        }
        return xarray.Dataset(
            {
                name: (dims, getattr(self, name), {"units": unit, "long_name": text})
                for name, (dims, unit, text) in maps.items()
            },
            {
                "component": ["x", "y"],
                "x": ("x", np.arange(columns) - 0.5 * (columns - 1), {"units": "pixel"}),
                "y": ("y", np.arange(rows) - 0.5 * (rows - 1), {"units": "pixel"}),
            },
            {
                "pixel_tangent": self.camera.pixel_tangent,
                "scene_pixel_m": self.camera.scene_pixel,
                "wavelength": self.wavelength,
                "sign_convention": "displacement of the picture's content, along x and y of the pupil",
            },
        )

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the size of the displacement on matplotlib axes; return the axes."""
        axes, size = drawn_on(axes), np.hypot(self.displacement[..., 0], self.displacement[..., 1])
        if is_flat([0.0, *size.ravel()], "pixel"):
            say_flat(axes, "no displacement, but for rounding")
            return axes
        drawn = axes.imshow(size, origin="lower", cmap="viridis")
        axes.figure.colorbar(drawn, ax=axes, label="displacement [pixels]")
        axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
        return axes

    def __repr__(self) -> str:
        """Size and greatest displacement."""
        rows, columns = self.through.shape
        size = np.hypot(self.displacement[..., 0], self.displacement[..., 1])
        seen = np.isfinite(size)
        greatest = f"{size[seen].max():.4g}" if seen.any() else "none"
        return f"BackgroundDisplacement of {rows} x {columns} pixels: up to {greatest} pixels"


@checked
def background_displacement(
    field: IndexField,
    camera: Camera,
    *,
    aperture_rays: int = APERTURE_RAYS,
    shape: tuple[int, int] | None = None,
    wavelength: float | None = None,
    **options: Unpack[TraceOptions],
) -> BackgroundDisplacement:
    """Trace the displacement of a camera's picture by a flow, for every pixel.

    Args:
        field: The refractive index.
        camera: The camera; its scene may be far.
        aperture_rays: Approximate number of points of the aperture; 1 takes only its middle.
        shape: Rows and columns, which override the camera's.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        options: tolerance [waves], method, step, max_steps, backend, device, precision: see `trace`; and
            allow_truncation, whether more than a thousandth of the picture's light may come through disturbed air that
            was cut off the field. Affected pixels are marked in `known`; if they are fewer, there is only a warning.

    Raises:
        TypeError: `field` or `camera` is of the wrong type, or an option is unknown.
        ValueError: A number is out of range, no ray of the camera meets the field, or the view is truncated and
            `allow_truncation` is not set.
    """
    whole = view_options(field, camera, wavelength, options)
    size = camera.shape() if shape is None else rows_and_columns(shape, "shape")
    return gather(field, camera, size, aperture_rays, whole)


def gather(
    field: IndexField,
    camera: Camera,
    shape: tuple[int, int],
    aperture_rays: int,
    options: dict[str, Any],
    visit: Visit | None = None,
) -> BackgroundDisplacement:
    """Return the displacement; call `visit` for each point of the aperture while its rays exist."""
    options = dict(options)
    allowed = options.pop("allow_truncation")
    with clocked() as seconds, stage("landing"):
        points = camera.aperture(aperture_rays)
        tolerance = options["tolerance"] * field.wavelength_for(options["wavelength"])
        view = KnownView(field, camera, points, tolerance, options)
        view.check(shape, allowed)
        x, y = (axis.ravel() for axis in np.meshgrid(*camera.tangents(shape)))
        name = "position" if np.isfinite(camera.distance) else "direction"
        through, mean, square = np.zeros(shape), np.zeros((*shape, 2)), np.zeros((*shape, 2))
        for point, weight in zip(points.points, points.weights.tolist(), strict=True):
            traced = trace(field, camera.rays(point, x, y), until=camera.scene_plane, outputs=(name,), **options)
            arrived = reached(traced.traced_status).reshape(shape)
            moved = camera.shift(getattr(traced, name), point, x, y).reshape(*shape, 2)
            moved[~arrived] = 0.0
            if visit is not None:
                visit(point, weight, moved, arrived)
            through += weight * arrived
            mean += weight * moved
            if len(points.points) > 1:  # one ray has no spread
                square += weight * moved**2
        light = np.maximum(through, 1e-300)[..., None]
        if len(points.points) > 1:
            mean /= light
            square = np.sqrt(np.maximum(square / light - mean**2, 0.0))
        mean = -mean
        mean[through == 0.0] = square[through == 0.0] = np.nan
    return BackgroundDisplacement(
        displacement=mean,
        blur=square,
        through=through,
        camera=camera,
        wavelength=traced.wavelength,
        plan=traced.plan,
        seconds=seconds,
        view=view,
    )


def view_options(
    field: IndexField, camera: Camera, wavelength: float | None, options: TraceOptions, sensor: Sensor | None = None
) -> dict[str, Any]:
    """Return all options of a view; check types and tolerance, and that light from a far scene leaves the field."""
    if not isinstance(field, IndexField):
        raise wrong_kind(field, "field", "an IndexField")
    if not isinstance(camera, Camera):
        raise TypeError(f"camera must be a Camera, got {type(camera).__name__}")
    if sensor is not None and not isinstance(sensor, Sensor):
        raise TypeError(f"sensor must be a Sensor, got {type(sensor).__name__}")
    whole: dict[str, Any] = {**complete(options), "wavelength": wavelength}
    check_positive(whole["tolerance"], "tolerance", "waves")
    if not np.isfinite(camera.distance):
        plane_beyond(field, camera.pupil, camera.pupil.normal)
    return whole


def _others(count: int, many: int) -> int:
    """Return the number of points for the error of a mean over `count` points: `many`, or a quarter of more."""
    return many if count < many else max(count // 4, 2)
