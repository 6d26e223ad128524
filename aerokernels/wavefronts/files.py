"""Wavefronts in files: FITS, and the NetCDF file of a dataset of `Wavefront.to_xarray`."""

from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..files.netcdf_reading import open_netcdf
from ..files.writing import replacing
from ..inputs.arguments import checked
from ..process.foreign_files import fault_text
from .exports import from_xarray, package, poppy_opd

W = TypeVar("W", bound=Any)  # Wavefront, whose methods these are
# The units of an OPD in a FITS file [m].
FITS_UNITS = {"meter": 1.0, "m": 1.0, "micron": 1e-6, "um": 1e-6, "nanometer": 1e-9, "nm": 1e-9}


@checked
def to_fits(wavefront: Any, path: str | Path) -> tuple[Path, Path]:
    """Write the OPD [m], in poppy's sign, and the amplitude, which `Wavefront.read` reads again; return both paths.

    Rows are along y and columns along x, both ascending: FITS' first axis is x, and its first pixel at the lowest x
    and y. The first file has the errors of the pixels [m] as its extension ERROR, the second their INTENSITY.

    Raises:
        ModuleNotFoundError: astropy is not installed.
        ValueError: The path is a folder, or its folder does not exist.
        OutputError: The disk is full; earlier files are as they were.
    """
    path = Path(path)
    fits = package("astropy.io.fits")
    amplitude = path.with_name(f"{path.stem}_amplitude{path.suffix}")
    with replacing(path, amplitude) as drafts:
        maps = (
            ("OPD", poppy_opd(wavefront), "ERROR", wavefront.pixel_errors),
            ("AMPLITUD", np.array(wavefront.weight), "INTENSITY", np.array(wavefront.intensity)),
        )
        for draft, (kind, array, name, beside) in zip(drafts, maps, strict=True):
            header = fits.Header()
            header["PIXELSCL"] = (wavefront.pixel, "[m/pixel]")
            header["PUPLSCAL"] = (wavefront.pixel, "[m/pixel]")
            if kind == "OPD":
                header["BUNIT"] = "meter"
            header["CONTENT"] = (kind, "what the pixels hold")
            header["WAVELEN"] = (wavefront.wavelength, "[m] vacuum wavelength")
            header["OPDSIGN"] = ("NEGATIVE", "where light is delayed (poppy's sign)")
            header["ZRADIUS"] = (wavefront.radius, "[m] unit disc of Zernike polynomials")
            parts = [fits.PrimaryHDU(array, header), fits.ImageHDU(beside, name=name)]
            fits.HDUList(parts).writeto(draft, overwrite=True)
    return path, amplitude


def _from_fits(path: Path, wavelength: float | None) -> dict[str, Any]:
    """Return the attributes of the wavefront of a FITS file by name."""
    fits = package("astropy.io.fits")
    amplitude = path.with_name(f"{path.stem}_amplitude{path.suffix}")
    try:
        with fits.open(path, memmap=False) as parts:
            header = dict(parts[0].header)
            opd = np.array(parts[0].data, dtype=np.float64)
            error = np.array(parts["ERROR"].data, dtype=np.float64) if "ERROR" in parts else None
        weight, found = np.isfinite(opd).astype(float), {}
        if amplitude.exists():
            with fits.open(amplitude, memmap=False) as parts:
                weight = np.array(parts[0].data, dtype=np.float64)
                if "INTENSITY" in parts:
                    found["intensity"] = np.array(parts["INTENSITY"].data, dtype=np.float64)
    except (OSError, TypeError, ValueError) as fault:
        raise ValueError(f"{path}: no FITS file of a map: {fault_text(fault)}") from fault
    sides = [float(header[name]) for name in ("PUPLSCAL", "PIXELSCL") if name in header]
    unit = str(header.get("BUNIT", "not stated")).strip().lower()
    if not sides or unit not in FITS_UNITS:
        raise ValueError(
            f"{path}: the header must state the side of a pixel, PIXELSCL [m/pixel], and the unit of the OPD, BUNIT, "
            f"among {', '.join(FITS_UNITS)}; its BUNIT is {unit!r}"
        )
    if "WAVELEN" not in header and wavelength is None:
        raise ValueError(f"{path}: the header has no WAVELEN: give the wavelength [m], such as wavelength=905e-9")
    sign = 1.0 if str(header.get("OPDSIGN", "NEGATIVE")).strip().upper() == "POSITIVE" else -1.0
    if error is not None and np.isfinite(error[weight > 0.0]).all():
        found["error_map"] = np.nan_to_num(error)
    return {
        "opd": sign * FITS_UNITS[unit] * opd + 0.0,
        "weight": weight,
        "pixel": sides[0],
        "wavelength": float(header["WAVELEN"]) if wavelength is None else wavelength,
        "radius": float(header["ZRADIUS"]) if "ZRADIUS" in header else None,
        **found,
    }


@checked
def read(cls: type[W], /, path: str | Path, *, wavelength: float | None = None) -> W:
    """Read the wavefront of a file, with the errors of its pixels if the file has them.

    The file is one that `wave.to_xarray().to_netcdf(path)` wrote, or the FITS file of an OPD, such as the first one
    of `to_fits` or one of poppy: rows along y and columns along x, both ascending; PIXELSCL [m/pixel]; BUNIT meter,
    micron or nm; delayed light negative, unless the header says OPDSIGN = POSITIVE. A file of the same name that
    ends in _amplitude has the transmission; without it all finite pixels are open.

    Args:
        cls: The class of the wavefront.
        path: The file.
        wavelength: Vacuum wavelength [m]; None takes that of the file.

    Raises:
        ModuleNotFoundError: A FITS file, and astropy is not installed.
        ValueError: A file that does not exist, is damaged, or lacks one of these statements.
    """
    path = Path(path)
    if path.is_file():
        with path.open("rb") as stream:
            if stream.read(6) == b"SIMPLE":
                return cls(**_from_fits(path, wavelength))
    wave = from_xarray(cls, open_netcdf(path, str(path), whole=True))
    return wave if wavelength is None else wave.at_wavelength(wavelength)
