"""Write brightness as a 16-bit grey picture file."""

import io
from pathlib import Path

import numpy as np

from .drafts import replacing

# Formats by the ending of the file.
FORMATS = {".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG"}


def write_grey(path: str | Path, brightness, format: str | None = None) -> None:
    """Write brightness 0 to 1, with rows from the lowest up, as a 16-bit grey picture, uppermost row first.

    Args:
        path: The file.
        brightness: Shape (rows, columns); NaN is black.
        format: "PNG" or "TIFF"; None takes that of the file's ending.

    Raises:
        ValueError: Another ending, a folder that does not exist, or an array that has not two axes.
        OutputError: The disk is full; an earlier file is as it was.
    """
    from PIL import Image

    path, brightness = Path(path), np.asarray(brightness)
    format = format or FORMATS.get(path.suffix.lower())
    if format is None:
        raise ValueError(f"picture {path}: the ending must be one of {', '.join(FORMATS)}")
    if brightness.ndim != 2:
        raise ValueError(f"a picture must have two axes [y, x], got shape {brightness.shape}")
    levels = np.rint(np.clip(np.nan_to_num(brightness), 0.0, 1.0) * 65535.0).astype(np.uint16)
    made = io.BytesIO()  # Pillow does not notice that a full disk takes a part of the last block only
    Image.fromarray(np.ascontiguousarray(levels[::-1])).save(made, format=format)
    with replacing(path) as (draft,):
        draft.write_bytes(made.getbuffer())
