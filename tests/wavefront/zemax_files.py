"""Zemax grid files as a program reads them that takes our exports."""

from pathlib import Path

import numpy as np


def read_zemax(path) -> tuple[np.ndarray, np.ndarray, float]:
    """Values of a grid file in our order of rows, shape (n, n), which of them are data, and the pixel [m].

    Raises:
        ValueError: A file that is no square grid of that form.
    """
    head, *rest = Path(path).read_text(encoding="ascii").split("\n")
    try:
        columns, rows, dx, dy, unit = (float(word) for word in head.split()[:5])
        table = np.array([[float(word) for word in line.split()] for line in rest if line.strip()])
        height = table[:, 0].reshape(int(rows), int(columns))[::-1]
        lost = table[:, 4].reshape(height.shape)[::-1] if table.shape[1] > 4 else np.zeros(height.shape)
    except (ValueError, IndexError):
        raise ValueError(f"{path} is no Zemax grid file: nx ny dx dy unitflag, then a point a line") from None
    if dx != dy:
        raise ValueError(f"{path} has pixels of {dx:g} by {dy:g}: only square ones can be taken")
    return height, lost == 0.0, dx * (1e-3, 1e-2, 0.0254, 1.0)[int(unit)]
