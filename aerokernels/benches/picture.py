"""Pictures with their scale, synthetic or from a photograph: plotting, datasets, comparison of two halves."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..display.shown import drawn_on, extent_of
from ..files.writing import write_grey
from ..inputs.arguments import checked
from ..inputs.checks import check_choice, check_path
from ..process.foreign_files import NoRoomError, check_room

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class PictureView:
    """A picture with its scale.

    Attributes:
        intensity: Brightness, 0 black to 1 white, rows from the lowest up, shape (ny, nx).
        horizontal: Pixel centres along the horizontal [m], shape (nx,).
        vertical: Pixel centres along the vertical [m], shape (ny,).
    """

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray

    def plot(self, axes: Any = None) -> Any:
        """Draw the picture in grey over millimetres on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        ends = extent_of(1e3 * self.horizontal, 1e3 * self.vertical)
        axes.imshow(self.intensity, origin="lower", extent=ends, cmap="gray", vmin=0.0, vmax=1.0)
        axes.set(xlabel="horizontal [mm]", ylabel="vertical [mm]")
        return axes


@dataclass(frozen=True, eq=False, kw_only=True)
class TracedPicture(PictureView):
    """A picture made of traced light, rows from the lowest up.

    Attributes:
        blocked: pixels that the body hides, without deflection, shape (ny, nx).
        right: direction of the picture's horizontal axis, shape (3,).
        up: direction of its vertical axis, shape (3,).
        exposure: brightness of full light (a bright fringe, undisturbed light), 1 for white.
        known: pixels whose light is known, shape (ny, nx): see `LineOfSight.known`; None for all.
        measure_error: function of the brightness without sensor noise that returns its error; `error` calls it.
    """

    blocked: np.ndarray
    right: np.ndarray
    up: np.ndarray
    exposure: float = 1.0
    known: np.ndarray | None = None
    measure_error: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    @cached_property
    def error(self) -> np.ndarray:
        """Error of each pixel's brightness before the sensor, shape (ny, nx); NaN if it is not known.

        The light is traced again when it is first read: see picture_error.py.
        """
        return np.full(self.intensity.shape, np.nan) if self.measure_error is None else self.measure_error()

    # The kind of picture; maps beside the brightness by name: dimensions, unit, meaning; attributes by name.
    KIND: ClassVar[str]
    MAPS: ClassVar[dict[str, tuple[str, str, str]]]
    NUMBERS: ClassVar[dict[str, str]]

    def to_xarray(self) -> "xarray.Dataset":
        """Return the picture as a dataset with units."""
        maps = {name: (kind, getattr(self, name), unit, words) for name, (kind, unit, words) in self.MAPS.items()}
        maps["blocked"] = ("pixel", self.blocked.astype(np.int8), "1", "1 where the body hides the light")
        if self.known is not None:
            maps["known"] = ("pixel", self.known.astype(np.int8), "1", "0 where the light is not known")
        numbers = {name: getattr(self, own) for name, own in self.NUMBERS.items()}
        # No spacing is that of the infinite fringe; a pupil as a source is its text.
        numbers = {
            name: np.inf if one is None else one if isinstance(one, (int, float)) else str(one)
            for name, one in numbers.items()
        }
        shared = {"exposure": self.exposure, "right": self.right, "up": self.up}
        return picture_dataset(self, maps, {"kind": self.KIND, **numbers, **shared})


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Picture(PictureView):
    """A picture with its scale, such as a photograph.

    Raises:
        ValueError: shapes disagree, numbers are not finite, or centres do not increase evenly.
    """

    def __post_init__(self) -> None:
        """Check the values."""
        intensity = np.array(self.intensity, dtype=np.float64)
        if intensity.ndim != 2 or not np.isfinite(intensity).all():
            raise ValueError(f"a picture must be a two-axis array of finite brightness, got shape {intensity.shape}")
        object.__setattr__(self, "intensity", intensity)
        for name, count in (("horizontal", intensity.shape[1]), ("vertical", intensity.shape[0])):
            centres = np.array(getattr(self, name), dtype=np.float64)
            if centres.shape != (count,):
                raise ValueError(
                    f"{name} has shape {centres.shape}, the picture {intensity.shape}: give one centre for each pixel"
                )
            steps = np.diff(centres)
            if not np.isfinite(centres).all() or (steps <= 0.0).any() or np.ptp(steps) > 1e-6 * steps.max(initial=0.0):
                raise ValueError(f"{name}: the pixel centres must increase in even steps")
            object.__setattr__(self, name, centres)


def picture_dataset(
    picture: PictureView, extra: dict[str, tuple[str, np.ndarray, str, str]], attributes: dict[str, object]
) -> "xarray.Dataset":
    """Return a picture as a dataset: `intensity` over vertical and horizontal, and further arrays.

    `extra` has, by name, "pixel" for one value a pixel or "pixel direction" for a pair, array, unit and meaning.
    """
    import xarray

    dims = {"pixel": ("vertical", "horizontal"), "pixel direction": ("vertical", "horizontal", "direction")}
    variables = {
        "intensity": (dims["pixel"], picture.intensity, {"units": "1", "long_name": "brightness, 1 is white"}),
        **{
            name: (dims[kind], array, {"units": unit, "long_name": words})
            for name, (kind, array, unit, words) in extra.items()
        },
    }
    coordinates = {
        "horizontal": ("horizontal", picture.horizontal, {"units": "m", "long_name": "along the picture's horizontal"}),
        "vertical": ("vertical", picture.vertical, {"units": "m", "long_name": "along the picture's vertical"}),
    }
    if any(kind == "pixel direction" for kind, *_ in extra.values()):
        coordinates["direction"] = ("direction", np.array(["right", "up"]), {"units": "1", "long_name": "component"})
    return xarray.Dataset(variables, coordinates, attributes)


@dataclass(frozen=True, eq=False)
class HalfComparison(PictureView):
    """Upper half simulated, lower half measured.

    Attributes:
        intensity: the two halves on the simulation's pixels, mid-grey where the measured picture does not reach.
        simulated: the simulated picture's lower half on the common pixels, shape (m,).
        measured: the measured brightness there, scaled to the simulation's, shape (m,).
        correlation: Pearson's r of the two, over the common pixels of the lower half.
        gain: factor applied to the measured brightness.
        offset: offset added after that.
        covered: share of the lower half that the measured picture covers.
    """

    simulated: np.ndarray
    measured: np.ndarray
    correlation: float
    gain: float
    offset: float
    covered: float

    def to_xarray(self) -> "xarray.Dataset":
        """Return the picture as a dataset with units."""
        numbers = {name: getattr(self, name) for name in ("correlation", "gain", "offset", "covered")}
        return picture_dataset(self, {}, {"kind": "upper half simulated, lower half measured", **numbers})


@checked
def compare_halves(simulated: PictureView, measured: Picture) -> HalfComparison:
    """Combine the upper half of a simulated picture with the lower half of a measured one.

    The measured picture is interpolated to the simulation's pixels, and its brightness scaled such that its 5 % and 95
    % quantiles in the lower half are those of the simulation: exposure and film are not compared. Both pictures should
    have the same knife edge.

    Args:
        simulated: a synthetic picture along x, the axis at height 0.
        measured: a photograph with its scale, see `read_picture`.

    Raises:
        ValueError: the lower halves have fewer than 100 pixels in common, or one of them has a single brightness there.
    """
    from scipy.ndimage import map_coordinates

    below = simulated.vertical < 0.0
    columns = _places(simulated.horizontal, measured.horizontal)
    rows = _places(simulated.vertical[below], measured.vertical)
    inside = np.logical_and.outer(
        (rows >= 0.0) & (rows <= len(measured.vertical) - 1),
        (columns >= 0.0) & (columns <= len(measured.horizontal) - 1),
    )
    if inside.sum() < 100:
        raise ValueError(
            f"the measured picture has {int(inside.sum())} pixels in common with the simulation's lower half: "
            "check pixel_size and nose"
        )
    drawn = map_coordinates(
        measured.intensity, np.stack(np.meshgrid(rows, columns, indexing="ij")), order=1, mode="nearest"
    )
    ours, theirs = simulated.intensity[below][inside], drawn[inside]
    # A photograph finer than the simulation's pixels is sampled, not averaged: smooth it first if its grain matters.
    low, high = np.quantile(ours, (0.05, 0.95))
    dark, bright = np.quantile(theirs, (0.05, 0.95))
    if np.ptp(ours) == 0.0 or bright <= dark:
        raise ValueError("one of the pictures has a single brightness where they overlap: there is nothing to compare")
    gain = float((high - low) / (bright - dark))
    offset = float(low - gain * dark)
    intensity = np.array(simulated.intensity, dtype=np.float64)
    intensity[below] = np.where(inside, np.clip(gain * drawn + offset, 0.0, 1.0), 0.5)
    return HalfComparison(
        intensity=intensity,
        horizontal=simulated.horizontal,
        vertical=simulated.vertical,
        simulated=ours,
        measured=gain * theirs + offset,
        correlation=float(np.corrcoef(ours, theirs)[0, 1]),
        gain=gain,
        offset=offset,
        covered=float(inside.mean()),
    )


def _places(coordinates: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Convert coordinates [m] to positions relative to pixel centres [pixels]."""
    return (coordinates - centres[0]) / ((centres[-1] - centres[0]) / (len(centres) - 1))


COPIES = 3  # float64 arrays in memory at once while a picture is read
# Grey level of white, by Pillow's mode.
_FULL = {"1": 1.0, "L": 255.0, "I;16": 65535.0, "I;16B": 65535.0, "I;16L": 65535.0}


@checked
def read_picture(
    path: str | Path,
    *,
    pixel_size: float,
    nose: tuple[float, float],
    upstream: str = "right",
    roll: float = 0.0,
) -> Picture:
    """Read a photograph of a schlieren bench: PNG, TIFF, JPEG or another format of Pillow; colours become grey.

    The picture gets the scale and origin of the synthetic pictures along x: metres, the nose's tip at 0, the flow
    coming from the right.

    Args:
        path: the file.
        pixel_size: width of a pixel in the plane of the flow [m].
        nose: (column, row) of the nose's tip [pixels] from the centre of the upper left pixel, fractions allowed.
        upstream: side of the file's picture from which the flow comes, "right" or "left" (then the picture is
            mirrored).
        roll: angle by which the flow's axis is rotated in the file, from right toward up [rad]; the picture is rotated
            back.

    Raises:
        ValueError: the file does not exist, is not a picture, is truncated, too small or of a single brightness, or an
            argument is out of range.
    """
    path = check_path(path, "path")
    if not (np.isfinite(pixel_size) and pixel_size > 0.0):
        raise ValueError(f"pixel_size = {pixel_size}: give the width of a pixel in metres")
    tip = np.asarray(nose, dtype=np.float64)
    if tip.shape != (2,) or not np.isfinite(tip).all():
        raise ValueError(f"nose {nose!r}: give (column, row) of the nose's tip in pixels")
    check_choice(upstream, "upstream", ("right", "left"))
    if not (np.isfinite(roll) and abs(roll) < 0.5 * np.pi):
        raise ValueError(f"roll = {roll}: give an angle in radians between -pi/2 and pi/2")
    grey = _read_grey(path)
    count = grey.shape
    if not (0.0 <= tip[0] <= count[1] - 1 and 0.0 <= tip[1] <= count[0] - 1):
        raise ValueError(
            f"picture {path}: nose at column {tip[0]:g}, row {tip[1]:g} is outside its {count[1]} x {count[0]} pixels"
        )
    intensity = grey[::-1]
    column, row = tip[0], count[0] - 1 - tip[1]
    if roll != 0.0:
        intensity = _turned(intensity, (row, column), roll)
    if upstream == "left":
        intensity, column = intensity[:, ::-1], count[1] - 1 - column
    return Picture(
        intensity, (np.arange(count[1]) - column) * float(pixel_size), (np.arange(count[0]) - row) * float(pixel_size)
    )


@checked
def write_picture(path: str | Path, picture: PictureView) -> None:
    """Write the brightness of a picture as a 16-bit grey PNG, pixel for pixel, the uppermost row first.

    Raises:
        ValueError: The path is a folder, or its folder does not exist.
        OutputError: The disk is full; an earlier file is as it was.
    """
    write_grey(check_path(path, "path"), picture.intensity, "PNG")


def _read_grey(path: Path) -> np.ndarray:
    """Return the brightness, 0 to 1, the uppermost row first."""
    from PIL import Image, UnidentifiedImageError

    if path.is_dir() or not path.exists():
        raise ValueError(
            f"picture {path}: {'is a folder' if path.is_dir() else 'no such file'}; give a PNG or TIFF file"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings about files that are readable nevertheless
            with Image.open(path) as image:
                check_room(8.0 * COPIES * image.width * image.height, f"picture {path}: its head")
                frame_count = getattr(image, "n_frames", 1)
                grey = _as_grey(image)
    except NoRoomError:
        raise
    except UnidentifiedImageError:
        raise ValueError(f"picture {path}: not a readable picture; give a PNG or TIFF file") from None
    except Image.DecompressionBombError as error:
        raise ValueError(f"picture {path}: {error}; crop it to the part that is needed") from None
    except Exception as error:  # Pillow's readers raise any exception for truncated or damaged files
        raise ValueError(f"picture {path}: cannot be read, {error}; save it again") from None
    if frame_count > 1:
        raise ValueError(f"picture {path}: holds {frame_count} pictures; save the one to read as a file of its own")
    if min(grey.shape) < 16:
        raise ValueError(f"picture {path}: {grey.shape[1]} x {grey.shape[0]} pixels; at least 16 each way are needed")
    if not np.isfinite(grey).all():
        raise ValueError(f"picture {path}: {int(np.sum(~np.isfinite(grey)))} pixels are not finite; repair the file")
    if np.ptp(grey) == 0.0:
        raise ValueError(f"picture {path}: has a single brightness everywhere")
    return grey


def _as_grey(image) -> np.ndarray:
    if image.mode in _FULL:
        return np.asarray(image, dtype=np.float64) / _FULL[image.mode]
    if image.mode in ("I", "F"):  # the level of white is not known: scale from the darkest to the brightest pixel
        values = np.asarray(image, dtype=np.float64)
        span = np.ptp(values) if np.isfinite(values).all() else 0.0
        return (values - values.min()) / span if span > 0.0 else values
    return np.asarray(image.convert("L"), dtype=np.float64) / 255.0


def _turned(intensity: np.ndarray, centre: tuple[float, float], angle: float) -> np.ndarray:
    """Return the picture rotated by -angle about `centre` (row from below, column), with its edges continued."""
    from scipy.ndimage import affine_transform

    cosine, sine = np.cos(angle), np.sin(angle)
    # Maps each pixel (row, column) of the result to the rotated picture.
    matrix = np.array([[cosine, sine], [-sine, cosine]])
    middle = np.asarray(centre)
    return np.clip(affine_transform(intensity, matrix, middle - matrix @ middle, order=1, mode="nearest"), 0.0, 1.0)
