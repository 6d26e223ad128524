"""Background-oriented schlieren: pictures of a dot pattern with and without a flow in front, and the displacement.

Each pixel is the mean brightness of the pattern over rays from points of the aperture, which includes the depth of
field and the blur by the flow. Reference: M. Raffel, Exp. Fluids 56 (2015) 60.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from ..files.writing import replacing, write_grey, write_netcdf
from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from ..medium import IndexField
from ..process.threads import in_threads
from ..sensor import Sensor
from ..tracing.plan import TraceOptions
from .camera import Camera
from .shift import BackgroundDisplacement, gather, view_options

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

# Points of the aperture for a picture, and margin of a pattern around it [pixels].
APERTURE_RAYS, MARGIN = 16, 32


@dataclass(frozen=True, eq=False)
class Background:
    """A picture in the plane of the scene."""

    brightness: np.ndarray  # brightness 0 to 1, shape (rows, columns), axes [y, x]; its border is continued outside
    sample: float  # spacing of its samples in pixels of the camera's picture
    # Whether samples are squares of uniform brightness, over which a pixel of the camera takes the exact mean;
    # otherwise they are interpolated by a cubic spline.
    squares: bool = False

    @classmethod
    def of_scene(cls, brightness, pixel: float, camera: Camera) -> "Background":
        """Make the background of a picture with pixels of `pixel` [m] in the scene's plane, centred on the axis."""
        brightness = np.asarray(brightness, dtype=np.float64)
        if brightness.ndim != 2 or min(brightness.shape) < 2 or not np.isfinite(brightness).all():
            raise ValueError(f"a background must be a finite array [y, x], got shape {brightness.shape}")
        if not (np.isfinite(pixel) and pixel > 0.0):
            raise ValueError(f"the background's pixel must be a positive length [m], got {pixel!r}")
        sample = float(pixel) / camera.scene_pixel
        return cls(brightness, sample, squares=sample <= 2.0 / 3.0)

    def prepared(self) -> np.ndarray:
        """Return spline coefficients of the brightness averaged over a camera pixel; for squares, cumulative sums."""
        if self.squares:
            padded = np.pad(self.brightness, self._edge, mode="edge")
            return np.pad(padded.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        from scipy.ndimage import correlate1d, spline_filter

        # Weights of a mean over a pixel of the camera: the end samples count by their share.
        width = 1.0 / self.sample
        half = int(np.ceil(0.5 * width - 0.5))
        box = np.clip(0.5 * width - np.abs(np.arange(-half, half + 1)) + 0.5, 0.0, 1.0)
        box /= box.sum()
        smooth = self.brightness
        for axis in (0, 1):
            smooth = correlate1d(smooth, box, axis=axis, mode="nearest")
        return np.asarray(spline_filter(smooth, order=3, mode="nearest"))

    def seen(self, prepared: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the brightness at positions relative to the middle [pixels], arrays of one shape."""
        from scipy.ndimage import map_coordinates

        darkest, brightest = self.brightness.min(), self.brightness.max()
        if self.squares:
            return np.clip(self._mean(prepared, row, column), darkest, brightest)
        place = [
            values / self.sample + 0.5 * (count - 1)
            for values, count in zip((row, column), prepared.shape, strict=True)
        ]
        result = map_coordinates(prepared, place, order=3, mode="nearest", prefilter=False)
        # A spline overshoots near hard edges.
        return np.asarray(np.clip(result, darkest, brightest, out=result))

    @property
    def _edge(self) -> int:
        """Samples by which squares are continued beyond the border, for camera pixels outside."""
        return int(np.ceil(1.0 / self.sample)) + 1

    def _mean(self, sums: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the mean of the squares over camera pixels at positions from the middle [pixels]."""
        from scipy.ndimage import map_coordinates

        half = 0.5 / self.sample
        middle = [
            np.clip(values / self.sample + 0.5 * (count - 1), half, count - 1 - half)
            for values, count in zip((row, column), sums.shape, strict=True)
        ]
        total = np.zeros(np.shape(row))
        for up in (-1.0, 1.0):
            for along in (-1.0, 1.0):
                corner = [middle[0] + up * half, middle[1] + along * half]
                total += up * along * map_coordinates(sums, corner, order=1, mode="nearest")
        return np.asarray(total * self.sample**2)


@checked
@dataclass(frozen=True)
class DotPattern:
    """Random bright Gaussian dots on black.

    Attributes:
        diameter: Diameter of a dot, to 1 / e^2 of its brightness [pixels of the picture].
        density: Dots per pixel of the picture.
        seed: Seed of the random pattern.

    Raises:
        ValueError: A number is out of range.
    """

    diameter: float = 2.5
    density: float = 0.12
    seed: int = 0

    def __post_init__(self):
        """Check the values."""
        for name in ("diameter", "density"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"{name} = {getattr(self, name)!r}: give a positive number")
        if self.diameter < 1.0:
            raise ValueError(f"diameter = {self.diameter:g} pixels: dots below one pixel are not resolved")

    def background(self, shape: tuple[int, int], margin: float) -> Background:
        """Return the pattern for a picture of (rows, columns) with a margin around it [pixels]."""
        sample = 0.5  # two samples per pixel, along each side
        rows, columns = (int(np.ceil((count + 2.0 * margin) / sample)) for count in shape)
        draw = np.random.default_rng(self.seed)
        count = max(1, int(round(self.density * rows * columns * sample**2)))
        y, x = draw.random(count) * rows, draw.random(count) * columns
        radius = 0.5 * self.diameter / sample
        reach = int(np.ceil(2.0 * radius))
        covered = np.zeros(rows * columns)  # -log(1 - brightness): overlapping dots do not exceed white
        i, j = np.floor(y).astype(int), np.floor(x).astype(int)
        for di in range(-reach, reach + 1):
            for dj in range(-reach, reach + 1):
                row, column = i + di, j + dj
                inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
                square = (row - y)[inside] ** 2 + (column - x)[inside] ** 2
                light = -np.log1p(-0.98 * np.exp(-2.0 * square / radius**2))
                covered += np.bincount((row * columns + column)[inside], weights=light, minlength=covered.size)
        return Background(1.0 - np.exp(-covered.reshape(rows, columns)), sample)


@dataclass(frozen=True, eq=False, repr=False)
class BackgroundPictures:
    """Two pictures of a background, and its displacement by the flow.

    Attributes:
        reference: Brightness without the flow, 0 to 1, axes [y, x], rows from the lowest up.
        picture: Brightness through the flow, of the same shape.
        traced: The ray-traced displacement.
    """

    reference: np.ndarray
    picture: np.ndarray
    traced: BackgroundDisplacement

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of the pattern along x and y [pixels], shape (rows, columns, 2); see BackgroundDisplacement."""
        return self.traced.displacement

    def write(self, folder: str | Path, format: str = "tiff") -> tuple[Path, Path]:
        """Write both pictures in 16-bit grey, the uppermost row first, and the displacement as NetCDF beside them.

        A file's rows run downward: a displacement correlated along increasing row numbers is minus the one along y.

        Returns:
            The paths of the reference and of the picture.

        Raises:
            ValueError: `format` is neither "tiff" nor "png".
            OutputError: The disk is full; earlier files are as they were.
        """
        check_choice(format, "format", ("tiff", "png"))
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        paths = folder / f"reference.{format}", folder / f"flow.{format}"
        with replacing(*paths, folder / "displacement.nc") as (*drafts, displacement):
            for path, brightness in zip(drafts, (self.reference, self.picture), strict=True):
                write_grey(path, brightness)
            write_netcdf(displacement, self.traced.to_xarray())
        return paths

    def to_xarray(self) -> "xarray.Dataset":
        """Return pictures and displacement as a dataset with units."""
        words = {"units": "1", "long_name": "brightness, 1 is white"}
        return self.traced.to_xarray().assign(
            reference=(("y", "x"), self.reference, words), picture=(("y", "x"), self.picture, words)
        )

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the size of the displacement on matplotlib axes; return the axes."""
        return self.traced.plot(axes)

    def __repr__(self) -> str:
        """Size and greatest displacement."""
        return repr(self.traced).replace("BackgroundDisplacement", "BackgroundPictures", 1)


@checked
def bos(
    field: IndexField,
    camera: Camera,
    pattern: DotPattern | np.ndarray | None = None,
    *,
    pattern_pixel: float | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
    aperture_rays: int = APERTURE_RAYS,
    wavelength: float | None = None,
    **options: Unpack[TraceOptions],
) -> BackgroundPictures:
    """Simulate the pictures of a bench for background-oriented schlieren.

    Args:
        field: The refractive index.
        camera: The camera; the pattern is in the plane of its scene, at a finite distance.
        pattern: A DotPattern, or a picture of brightness 0 to 1, axes [y, x], centred on the camera's axis.
        pattern_pixel: Side of a pixel of such a picture in the scene [m]; None takes the camera's. Pixels up to two
            thirds of the camera's are treated as squares, over which a camera's pixel averages; wider ones are
            interpolated by a spline.
        sensor: Adds noise and grey levels; None leaves the brightness as it is.
        seed: Seed of the noise, which is independent in the two pictures.
        aperture_rays: Approximate number of points of the aperture.
        wavelength: As in `background_displacement`.
        options: As in `background_displacement`.

    Raises:
        TypeError: An argument is of the wrong type, or an option is unknown.
        ValueError: A number is out of range, the scene is infinitely far, no ray meets the field, or the view is
            truncated and `allow_truncation` is not set.
    """
    whole = view_options(field, camera, wavelength, options, sensor)
    if not np.isfinite(camera.distance):
        raise ValueError("the pattern is at the camera's distance, which is infinite: give a finite distance [m]")
    shape = camera.shape(None if isinstance(pattern, DotPattern) else pattern)
    out_of_focus = (1.0 - camera.distance / camera.focus_distance) / camera.scene_pixel
    if pattern is None or isinstance(pattern, DotPattern):
        margin = MARGIN + abs(out_of_focus) * camera.pupil.reach
        background = (pattern or DotPattern()).background(shape, margin)
    else:
        size = camera.scene_pixel if pattern_pixel is None else pattern_pixel
        background = Background.of_scene(pattern, size, camera)
    prepared = background.prepared()
    rows, columns = (np.arange(count) - 0.5 * (count - 1) for count in shape)
    reference, picture = np.zeros(shape), np.zeros(shape)

    def visit(point: np.ndarray, weight: float, moved: np.ndarray, arrived: np.ndarray) -> None:
        def add(part: slice) -> None:
            row = np.broadcast_to(rows[part, None] + out_of_focus * point[1], arrived[part].shape)
            column = np.broadcast_to(columns + out_of_focus * point[0], arrived[part].shape)
            reference[part] += weight * background.seen(prepared, row, column)
            seen = background.seen(prepared, row + moved[part, :, 1], column + moved[part, :, 0])
            picture[part] += weight * arrived[part] * seen

        step = max(1, (1 << 14) // shape[1])  # speed only
        in_threads(add, [slice(first, min(first + step, shape[0])) for first in range(0, shape[0], step)])

    traced = gather(field, camera, shape, aperture_rays, whole, visit)
    if sensor is not None:
        reference, picture = sensor.expose(reference, seed=2 * seed), sensor.expose(picture, seed=2 * seed + 1)
    return BackgroundPictures(reference, picture, traced)
