"""Export to Zemax OpticStudio grid files (.dat) for Grid Phase and Grid Sag surfaces.

    nx ny delx dely unitflag xdec ydec                    unitflag 0: mm
    z dz/dx dz/dy d2z/dxdy nodata                         one line a point, from -x +y along +x, then row by row to -y

Phases are in radians and sags in mm. The sign is Zemax's, opposite to the one here: delayed light has negative values.
All derivatives are 0, so that OpticStudio fits its own splines. `nodata` is 1 outside the pupil.
"""

from pathlib import Path

import numpy as np

from aerokernels.files.writing import replacing

from ...inputs.arguments import checked
from ...inputs.checks import check_choice
from ..data import WavefrontMap

KINDS = ("phase", "sag")


@checked
def to_zemax(wavefront: WavefrontMap, path: str | Path, kind: str = "phase") -> None:
    """Write a Zemax grid file.

    Raises:
        ValueError: `kind` is neither "phase" nor "sag", or the path is a folder or in none.
        OutputError: The disk is full; an earlier file is as it was.
    """
    check_choice(kind, "kind", KINDS)
    scale = 2.0 * np.pi / wavefront.wavelength if kind == "phase" else 1e3
    height = np.where(wavefront.lit, -scale * wavefront.opd, 0.0)[::-1]
    lost = (~wavefront.lit)[::-1]
    count, pixel = len(height), wavefront.pixel * 1e3
    lines = [f"{count} {count} {pixel:.17g} {pixel:.17g} 0 0 0"]
    lines += [f"{z:.17g} 0 0 0 {int(no)}" for z, no in zip(height.ravel() + 0.0, lost.ravel(), strict=True)]
    with replacing(Path(path)) as (draft,):
        draft.write_text("\n".join(lines) + "\n", encoding="ascii")
