"""Export of wavefronts to other packages and formats, in their units and signs; each package is imported when used.

poppy (since 1.0) and Zemax have the opposite sign of OPD; HCIPy and prysm have ours, and our order of axes.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ..files.writing import replacing
from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from .point_spread import complex_amplitude


@checked
def to_fits(wavefront: Any, path: str | Path) -> tuple[Path, Path]:
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


def to_hcipy(wavefront: Any):
    """Return a hcipy.Wavefront of the field w exp(i k OPD) on a regular grid in metres, x running fastest.

    Its `electric_field` is a hcipy.Field, which hcipy.write_field saves as ASDF. FITS files have no complex numbers:
    save its `amplitude` and its `phase`.

    Raises:
        ModuleNotFoundError: hcipy is not installed.
    """
    hcipy = package("hcipy")
    count, pixel = len(wavefront.opd), wavefront.pixel
    first = float(wavefront.coordinate[0])
    grid = hcipy.CartesianGrid(hcipy.RegularCoords([pixel, pixel], [count, count], [first, first]))
    field = complex_amplitude(wavefront.opd, wavefront.weight, wavefront.wavelength)
    return hcipy.Wavefront(hcipy.Field(np.ravel(field), grid), wavefront.wavelength)


def package(name: str) -> Any:
    """Import a module of another package.

    Raises:
        ModuleNotFoundError: The package is not installed; the message says how to install it.
    """
    own = name.split(".")[0]
    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        if fault.name != own:
            raise  # a dependency of the package is missing
        message = f"{own} is not installed, which this export needs: pip install 'aerokernels[exchange]'"
        raise ModuleNotFoundError(message, name=own) from None


def to_poppy(wavefront: Any):
    """Return a poppy.ArrayOpticalElement: `transmission` (amplitude), `opd` [m] in poppy's sign, `pixelscale`.

    `pixelscale` is in m / pixel; `pupil_diam` is the side of the map [m].

    Raises:
        ModuleNotFoundError: poppy is not installed.
    """
    poppy, units = package("poppy"), package("astropy.units")
    element = poppy.ArrayOpticalElement(
        name="aerokernels wavefront",
        transmission=np.array(wavefront.weight),
        opd=poppy_opd(wavefront),
        pixelscale=wavefront.pixel * units.m / units.pixel,
    )
    # An OpticalSystem without an entrance pupil takes its diameter from here, as from elements read from files.
    element.pupil_diam = len(wavefront.opd) * wavefront.pixel * units.m
    return element


def poppy_opd(wavefront: Any) -> np.ndarray:
    """Return the OPD in poppy's sign [m], 0 outside the pupil, shape (n, n)."""
    return np.where(wavefront.lit, -wavefront.opd, 0.0)


def to_prysm(wavefront: Any):
    """Return a prysm.propagation.Wavefront: amplitude, OPD as its phase [nm], wavelength [um], dx [mm].

    Raises:
        ModuleNotFoundError: prysm is not installed.
    """
    prysm = package("prysm.propagation")
    phase = np.where(wavefront.lit, wavefront.opd, 0.0) * 1e9
    return prysm.Wavefront.from_amp_and_phase(
        np.array(wavefront.weight), phase, wavefront.wavelength * 1e6, wavefront.pixel * 1e3
    )


KINDS = ("phase", "sag")


@checked
def to_zemax(wavefront: Any, path: str | Path, kind: str = "phase") -> None:
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
