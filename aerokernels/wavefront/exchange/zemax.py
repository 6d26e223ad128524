"""Wavefronts as Zemax OpticStudio grid files (.dat), of which Grid Phase and Grid Sag surfaces are made.

    nx ny delx dely unitflag xdec ydec                    unitflag 0: mm
    z dz/dx dz/dy d2z/dxdy nodata                         one line a point, from -x +y along +x, then row by row to -y

Phases are in radians and sags in mm; the sign is Zemax's, opposite to ours: where light is delayed it is negative.
Derivatives are 0 in all lines, which has OpticStudio fit splines of its own. `nodata` is 1 outside the pupil.
"""

from pathlib import Path

import numpy as np

from ...arguments import checked
from ...checks import check_choice
from ..data import WavefrontMap

KINDS = ("phase", "sag")


@checked
def to_zemax(wavefront: WavefrontMap, path: str | Path, kind: str = "phase") -> None:
    """Write a grid file.

    Raises:
        ValueError: A kind that is neither "phase" nor "sag".
    """
    check_choice(kind, "kind", KINDS)
    scale = 2.0 * np.pi / wavefront.wavelength if kind == "phase" else 1e3
    height = np.where(wavefront.lit, -scale * wavefront.opd, 0.0)[::-1]
    lost = (~wavefront.lit)[::-1]
    count, pixel = len(height), wavefront.pixel * 1e3
    lines = [f"{count} {count} {pixel:.17g} {pixel:.17g} 0 0 0"]
    lines += [f"{z:.17g} 0 0 0 {int(no)}" for z, no in zip(height.ravel() + 0.0, lost.ravel(), strict=True)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="ascii")


@checked
def read_zemax(path: str | Path) -> tuple[np.ndarray, np.ndarray, float]:
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
