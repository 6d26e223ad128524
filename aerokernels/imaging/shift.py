"""Where in the scene the pixels of a camera look through a flow, by rays from points of its aperture.

Rays of one point of the aperture are a bundle, of which `trace` traces few. A pixel's ray meets the scene at L with the
flow and at L0 without it; in pixels of the picture, and over the aperture with its weights,

    shift = mean (L - L0) / scene_pixel,      picture with the flow (pixel) = picture without it (pixel + shift)

so what is seen in a pixel was displaced by minus the shift. Of a far scene, tangents take the place of L / D.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..tracing.pupil_air import GREATEST_SHARE
from .camera import Camera, rows_and_columns
from .displacement_error import blur_error, by_points, displacement_error
from .known_view import KnownView
from .landing import by_rows, land, landing_shift

if TYPE_CHECKING:
    import xarray

# Points of the aperture: a ring of four has the exact mean of what changes by up to the third power across it.
APERTURE_RAYS = 4
# Points by which the error of a mean over fewer is told; of more, a quarter of them tell it.
OTHER_RAYS, BLUR_RAYS = 16, 36
# Of `trace` [waves].
DEFAULT_TOLERANCE = 1e-3
# The tolerance of rays that judge others, of theirs.
TIGHTER = 0.1
# Called by threads, each with rows of the picture of its own: (rows, point of the aperture [m], its share of the light,
# shifts [pixels] of shape (rows, columns, 2), and where rays arrived).
Visit = Callable[[slice, np.ndarray, float, np.ndarray, np.ndarray], None]
# Options that go on to `trace`.
TRACE_OPTIONS = ("method", "tolerance", "wavelength", "backend", "device", "precision", "step", "max_steps")


@dataclass(frozen=True, eq=False, repr=False)
class BackgroundDisplacement:
    """How a flow displaces what a camera sees, pixel by pixel.

    Attributes:
        displacement: Displacement of the picture's content through the flow, along x and y [pixels], at the place where
            it is seen through the flow, shape (rows, columns, 2); NaN where nothing is seen.
        blur: Root mean square distance of the aperture's rays from their mean in the scene, less what depth of field
            alone makes, along x and y [pixels], shape (rows, columns, 2).
        through: Share of the aperture whose rays reach the scene, shape (rows, columns).
        camera: The camera.
        wavelength: Vacuum wavelength [m].
        plan: How the rays of one point of the aperture were traced.
        seconds: Wall time by stage: see STAGES in clock.py.
        view: What was looked at, for `truncated` and `error`, which are computed when first read.
        options: Options of `trace` that it was looked at with.
    """

    displacement: np.ndarray
    blur: np.ndarray
    through: np.ndarray
    camera: Camera
    wavelength: float
    plan: Any = None
    seconds: dict[str, float] = field(default_factory=dict)
    view: KnownView | None = None
    options: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def error(self) -> np.ndarray:
        """What the size of the displacement may be off by [pixels], shape (rows, columns); NaN where it is not known.

        Through the field's grid (displacement_error.py), and where it is the mean over several points of the aperture,
        through their number: by its change for OTHER_RAYS of them, in the neighbouring pixels too. Three more bundles
        and those of the other points are traced when it is first read.
        """
        if self.view is None:
            return np.full(self.through.shape, np.nan)
        camera, shape, options = self.camera, self.through.shape, self.options
        grid = displacement_error(
            self.view.field, camera, shape, lambda field: landing_shift(field, camera, shape, np.zeros(2), options)
        )
        count = len(self.view.points)
        if count == 1:
            return grid
        changed = gather(self.view.field, camera, shape, _others(count, OTHER_RAYS), options, allow_truncation=True)
        return grid + by_points(changed.displacement - self.displacement)

    @cached_property
    def blur_error(self) -> np.ndarray:
        """What the blur may be off by, along x and y [pixels], shape (rows, columns, 2); NaN where it is not known.

        Through the field's grid, the rays' tolerance and the number of points of the aperture: see blur_error in
        displacement_error.py. Pictures of three fields and of 36 points are traced when it is first read.
        """
        if self.view is None:
            return np.full(self.blur.shape, np.nan)
        camera, shape, count = self.camera, self.through.shape, len(self.view.points)

        def seen(field: IndexField, points: int, tight: bool = False) -> np.ndarray:
            options = dict(self.options)
            if tight:
                tolerance = TIGHTER * float(options.get("tolerance", DEFAULT_TOLERANCE))
                options |= {"tolerance": tolerance, "precision": "float64"}
            return gather(field, camera, shape, points, options, allow_truncation=True).blur

        other = _others(count, BLUR_RAYS)
        return blur_error(self.view.field, camera, self.blur, count, other, seen)

    @cached_property
    def truncated(self) -> np.ndarray:
        """Share of each pixel's aperture that looks through disturbed air that ends with the field's box.

        Shape (rows, columns). Of those pixels the displacement is that of the known air alone. Computed when first
        read, along straight lines.
        """
        shape = self.through.shape
        return np.zeros(shape) if self.view is None else self.view.truncated(shape)

    @property
    def known(self) -> np.ndarray:
        """Which pixels see through known air: at most a thousandth of their aperture is truncated."""
        return self.truncated <= GREATEST_SHARE

    @property
    def shift(self) -> np.ndarray:
        """What a pixel sees less what it would see without the flow [pixels]: minus the displacement."""
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
        """The maps as a dataset with units over (y, x)."""
        import xarray

        pair, one = ("y", "x", "component"), ("y", "x")
        rows, columns = self.through.shape
        return xarray.Dataset(
            {
                "displacement": (
                    pair,
                    self.displacement,
                    {"units": "pixel", "long_name": "displacement through the flow"},
                ),
                "blur": (pair, self.blur, {"units": "pixel", "long_name": "rms spread of the aperture's rays"}),
                "through": (
                    one,
                    self.through,
                    {"units": "1", "long_name": "share of the aperture that sees the scene"},
                ),
                "truncated": (
                    one,
                    self.truncated,
                    {"units": "1", "long_name": "share of the aperture that sees beyond the known air"},
                ),
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

    def plot(self, axes=None):
        """Draw the size of the displacement on matplotlib axes; returns the axes."""
        from .plots import plot_displacement

        return plot_displacement(self, axes)

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
    allow_truncation: bool = False,
    **options: Any,
) -> BackgroundDisplacement:
    """Displacement of a camera's picture by a flow, for every pixel.

    Args:
        field: The refractive index.
        camera: The camera; its scene may be far.
        aperture_rays: Points of the aperture, about; 1 takes its middle alone.
        shape: Rows and columns where the camera says none.
        allow_truncation: Whether more than a thousandth of the picture's light may come through disturbed air that ends
            with the field's box. The pixels concerned are marked in `known`; where they are fewer, a warning says so.
        **options: method, tolerance [waves], wavelength, backend, device, precision, step, max_steps: as in `trace`.

    Raises:
        TypeError: `field` or `camera` of the wrong kind, or an unknown option.
        ValueError: A number that makes no sense, a camera none of whose rays meets the field, a truncated view without
            `allow_truncation`.
    """
    check_view(field, camera, options)
    size = camera.shape() if shape is None else rows_and_columns(shape, "shape")
    return gather(field, camera, size, aperture_rays, options, allow_truncation=allow_truncation)


def gather(
    field: IndexField,
    camera: Camera,
    shape: tuple[int, int],
    aperture_rays: int,
    options: dict[str, Any],
    visit: Visit | None = None,
    allow_truncation: bool = False,
) -> BackgroundDisplacement:
    """The displacement, and a `visit` for some rows and every point of the aperture, while its rays are there."""
    with clocked() as seconds, stage("landing"):
        points, weights = aperture(camera, aperture_rays)
        tolerance = float(options.get("tolerance", DEFAULT_TOLERANCE))
        lost = tolerance * field.wavelength_for(options.get("wavelength"))
        view = KnownView(field, camera, points, weights, lost)
        view.check(shape, allow_truncation)
        several = len(points) > 1
        through, mean = np.empty(shape), np.empty((*shape, 2))
        square = np.zeros((*shape, 2))  # the spread of one ray is none
        for number, (point, weight) in enumerate(zip(points, weights, strict=True)):
            landing = land(field, camera, shape, point, options)
            before = None if number == 0 else (through, mean, square)

            def add(rows: slice, landing=landing, weight=float(weight), before=before) -> None:
                moved, arrived = landing.moved(rows)
                if visit is not None:
                    visit(rows, landing.point, weight, moved, arrived)
                through[rows] = weight * arrived + (0.0 if before is None else through[rows])
                if several:
                    square[rows] += weight * moved**2
                    moved *= weight
                mean[rows] = moved if before is None else mean[rows] + moved

            by_rows(add, shape)

        def finish(rows: slice) -> None:
            seen, light = through[rows] > 0.0, np.maximum(through[rows], 1e-300)[..., None]
            if several:
                mean[rows] /= light
                square[rows] = np.sqrt(np.maximum(square[rows] / light - mean[rows] ** 2, 0.0))
            np.negative(mean[rows], out=mean[rows])
            if not seen.all():
                mean[rows][~seen] = square[rows][~seen] = np.nan

        by_rows(finish, shape)
    return BackgroundDisplacement(
        displacement=mean,
        blur=square,
        through=through,
        camera=camera,
        wavelength=landing.traced.wavelength,
        plan=landing.traced.plan,
        seconds=seconds,
        view=view,
        options=options,
    )


def check_view(field: IndexField, camera: Camera, options: dict[str, Any]) -> None:
    """Refuse what is no field, no camera or no option of `trace`."""
    if not isinstance(field, IndexField):
        raise TypeError(f"field must be an IndexField, got {type(field).__name__}")
    if not isinstance(camera, Camera):
        raise TypeError(f"camera must be a Camera, got {type(camera).__name__}")
    unknown = sorted(set(options) - set(TRACE_OPTIONS))
    if unknown:
        raise TypeError(f"options {unknown} are not known: choose from {', '.join(TRACE_OPTIONS)}")
    tolerance = options.get("tolerance", DEFAULT_TOLERANCE)
    if isinstance(tolerance, bool) or not isinstance(tolerance, Real):
        raise TypeError(f"tolerance must be a number of waves, got {tolerance!r}")
    check_positive(float(tolerance), "tolerance", "waves")


def _others(count: int, many: int) -> int:
    """Points of the aperture by which the error of a mean over some is told: many, or a quarter of more than that."""
    return many if count < many else max(count // 4, 2)


def aperture(camera: Camera, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of the aperture along its axes [m], shape (n, 2), and weights of their light, which sum to 1."""
    if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
        raise ValueError(f"aperture_rays must be a whole number of at least 1, got {count!r}")
    if count == 1:
        return np.zeros((1, 2)), np.ones(1)
    pupil = camera.pupil
    points, weight = pupil.sample(int(count), "gauss")
    flat = camera.across(points - pupil.center)
    # The weights are those of the amplitude: light counts by its square.
    light = weight * pupil.transmission(flat[:, 0], flat[:, 1])
    return flat, light / light.sum()
