"""Read a photograph of a bench with its scale, and write a picture pixel for pixel."""

import warnings
from pathlib import Path

import numpy as np

from ..files.writing import write_grey
from ..inputs.arguments import checked
from ..inputs.checks import check_choice, check_path
from ..process.foreign_files import NoRoomError, check_room
from .picture import Picture, PictureView

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
