"""Wavefronts as FITS files that poppy.FITSOpticalElement reads, as `transmission` and, by the second file, as `opd`.

poppy reads the first HDU of a file and its keywords PIXELSCL or PUPLSCAL [m/pixel] and BUNIT. So there are two files:
PATH holds the OPD in poppy's sign, PATH with "_amplitude" before its suffix the transmission.
"""

from pathlib import Path

import numpy as np

from aerokernels.files.writing import replacing

from ...inputs.arguments import checked
from ..data import WavefrontMap
from .packages import package
from .poppy import poppy_opd


@checked
def to_fits(wavefront: WavefrontMap, path: str | Path) -> tuple[Path, Path]:
    """Write the OPD [m], in poppy's sign, and the amplitude; return both paths.

    Raises:
        ModuleNotFoundError: astropy is not installed.
        ValueError: The path is a folder, or its folder does not exist.
        OutputError: The disk is full; earlier files are as they were.
    """
    path = Path(path)
    fits = package("astropy.io.fits")
    amplitude = path.with_name(f"{path.stem}_amplitude{path.suffix}")
    with replacing(path, amplitude) as drafts:
        for name, array, unit, kind in (
            (drafts[0], poppy_opd(wavefront), "meter", "OPD"),
            (drafts[1], np.array(wavefront.weight), "", "AMPLITUD"),
        ):
            header = fits.Header()
            header["PIXELSCL"] = (wavefront.pixel, "[m/pixel]")
            header["PUPLSCAL"] = (wavefront.pixel, "[m/pixel]")
            if unit:
                header["BUNIT"] = unit
            header["CONTENT"] = (kind, "what the pixels hold")
            header["WAVELEN"] = (wavefront.wavelength, "[m] vacuum wavelength")
            header["OPDSIGN"] = ("NEGATIVE", "where light is delayed (poppy's sign)")
            fits.PrimaryHDU(array, header).writeto(name, overwrite=True)
    return path, amplitude
