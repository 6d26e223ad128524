"""Export of wavefronts to other packages and formats, in their units and signs; each package is imported when used.

poppy (since 1.0) and Zemax have the opposite sign of OPD; HCIPy and prysm have ours, and our order of axes.
"""

import math
from dataclasses import fields
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from ..display.quantities import ErrorBudget
from ..files.writing import replacing
from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from ..pupils import Annulus, Disc, Mask, Polygon, Pupil, Rectangle
from .point_spread import complex_amplitude

if TYPE_CHECKING:
    import xarray

W = TypeVar("W", bound=Any)  # Wavefront, whose methods these are


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
    """Import a module of another package."""
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


@checked
def to_zemax(wavefront: Any, path: str | Path, kind: str = "phase") -> None:
    """Write a Zemax grid file.

    Raises:
        ValueError: `kind` is neither "phase" nor "sag", or the path is a folder or in none.
        OutputError: The disk is full; an earlier file is as it was.
    """
    check_choice(kind, "kind", ("phase", "sag"))
    scale = 2.0 * np.pi / wavefront.wavelength if kind == "phase" else 1e3
    height = np.where(wavefront.lit, -scale * wavefront.opd, 0.0)[::-1]
    lost = (~wavefront.lit)[::-1]
    count, pixel = len(height), wavefront.pixel * 1e3
    lines = [f"{count} {count} {pixel:.17g} {pixel:.17g} 0 0 0"]
    lines += [f"{z:.17g} 0 0 0 {int(no)}" for z, no in zip(height.ravel() + 0.0, lost.ravel(), strict=True)]
    with replacing(Path(path)) as (draft,):
        draft.write_text("\n".join(lines) + "\n", encoding="ascii")


SIGN_CONVENTION = "OPD is positive where light is delayed"
PUPILS: dict[str, Any] = {kind.__name__: kind for kind in (Annulus, Disc, Mask, Polygon, Rectangle)}


def to_xarray(wavefront: Any) -> "xarray.Dataset":
    """Return an xarray.Dataset of "opd", "opd_error", "weight" and "intensity" over (y, x); computes the errors."""
    import xarray

    attributes: dict[str, Any] = {
        "Conventions": "CF-1.8",
        "title": "wavefront over a pupil",
        "sign_convention": SIGN_CONVENTION,
        "wavelength": wavefront.wavelength,
        "pixel": wavefront.pixel,
        "radius": wavefront.radius,
        "blocked": wavefront.blocked,
        "removed": " ".join(wavefront.removed),
        "opd_error": wavefront.opd_error,
    }
    if wavefront.direction is not None:
        attributes["direction"] = np.asarray(wavefront.direction)
    maps = {
        "opd": ("m", "optical path difference"),
        "opd_error": ("m", "error of the optical path difference from its mean"),
        "weight": ("1", "transmission of the amplitude, mean over the pixel"),
        "intensity": ("1", "mean intensity in the pixel"),
    }
    variables, numbers = _pupil_numbers(wavefront.pupil)
    for name, (unit, words) in maps.items():
        values = wavefront.pixel_errors if name == "opd_error" else getattr(wavefront, name)
        variables[name] = (("y", "x"), values, {"units": unit, "long_name": words})
    variables["opd"][2]["sign_convention"] = SIGN_CONVENTION
    coordinates = {
        name: (name, wavefront.coordinate, {"units": "m", "long_name": f"{name} in the pupil, from its centre"})
        for name in ("x", "y")
    }
    return xarray.Dataset(variables, coordinates, {**attributes, **numbers})


def from_xarray(cls: type[W], dataset) -> W:
    """Make the wavefront of a dataset of `to_xarray`, or of one read from its NetCDF file."""
    if not hasattr(dataset, "attrs") or not hasattr(dataset, "data_vars"):
        raise TypeError(f"dataset must be an xarray.Dataset, as `to_xarray` makes one, got {type(dataset).__name__}")
    lost = [name for name in ("opd", "weight") if name not in dataset] + [
        name for name in ("wavelength", "pixel", "sign_convention") if name not in dataset.attrs
    ]
    if lost:
        raise ValueError(f"the dataset was not made by Wavefront.to_xarray: {', '.join(lost)} is missing")
    attributes = dataset.attrs
    if str(attributes["sign_convention"]) != SIGN_CONVENTION:
        raise ValueError(f"the dataset's sign convention is {attributes['sign_convention']!r}, not {SIGN_CONVENTION!r}")
    unit = str(dataset["opd"].attrs.get("units", "m"))
    if unit != "m":
        raise ValueError(f"the dataset's opd is in {unit!r}: convert it to metres, and set its units to 'm'")
    names = ("pixel", "wavelength", "radius", "blocked", "opd_error")
    numbers = {name: float(_numbers(attributes, name, ())) for name in names if name in attributes}
    error = numbers.pop("opd_error", np.nan)
    maps = {name: _map(dataset, name) for name in ("opd", "weight", "intensity") if name in dataset}
    _check_coordinates(dataset, maps["opd"].shape, numbers["pixel"])
    known = _map(dataset, "opd_error") if "opd_error" in dataset else None
    if known is not None and np.isfinite(known[maps["weight"] > 0.0]).all():
        maps["error_map"] = np.nan_to_num(known)
    return cls(
        **maps,
        **numbers,
        removed=tuple(str(attributes.get("removed", "")).split()),
        direction=_numbers(attributes, "direction", (3,)) if "direction" in attributes else None,
        pupil=_pupil(dataset),
        budget=partial(ErrorBudget, total=error) if np.isfinite(error) else None,
    )


def _pupil_numbers(pupil: Pupil | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a pupil's numbers as a dataset's variables (of two axes) and attributes (the others, and its class)."""
    variables: dict[str, Any] = {}
    attributes: dict[str, Any] = {}
    if pupil is not None:
        attributes["pupil"] = type(pupil).__name__
        for field in fields(cast(Any, pupil)):
            value, name = getattr(pupil, field.name), f"pupil_{field.name}"
            if np.ndim(value) == 2:
                variables[name] = ((f"{name}_row", f"{name}_column"), value)
            else:
                attributes[name] = value
    return variables, attributes


def _pupil(dataset) -> Pupil | None:
    """Return the pupil that a dataset was made with; None if it has none, or not all of its numbers."""
    kind = PUPILS.get(str(dataset.attrs.get("pupil")))
    if kind is None:
        return None
    result = {}
    for field in fields(kind):
        name = f"pupil_{field.name}"
        if name not in dataset and name not in dataset.attrs:
            return None
        result[field.name] = np.asarray(dataset[name] if name in dataset else dataset.attrs[name])
        if result[field.name].ndim < 2 and result[field.name].size == 1:  # files turn single numbers into arrays
            result[field.name] = result[field.name].item()
    return kind(**result)


def _map(dataset, name: str) -> np.ndarray:
    """Return a map [y, x] of a dataset."""
    own = dataset[name]
    if set(own.dims) != {"y", "x"} or own.ndim != 2 or own.dtype.kind not in "iuf":
        axes = ", ".join(map(str, own.dims))
        raise ValueError(f"the dataset's {name} must be numbers over (y, x), got {own.dtype} over ({axes})")
    return np.asarray(own.variable.transpose("y", "x"))  # the variable alone: its coordinates are not needed


def _check_coordinates(dataset, shape: tuple[int, ...], pixel: float) -> None:
    """Check that x and y, where the dataset has them, are those of pixels about the pupil's centre, ascending."""
    for name, count in zip(("y", "x"), shape, strict=True):
        if name not in dataset.coords:
            continue
        result, expected = np.asarray(dataset[name]), pixel * (np.arange(count) - 0.5 * (count - 1))
        # A file may hold coordinates in single precision.
        is_right = result.dtype.kind in "iuf" and result.shape == (count,)
        if not (is_right and np.abs(result - expected).max(initial=0.0) <= 1e-3 * pixel):
            raise ValueError(
                f"the dataset's {name} must ascend about the pupil's centre in steps of its pixel, {pixel:g} m: give "
                "the whole map, not cut, thinned out or flipped"
            )


def _numbers(attributes, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return an attribute of a dataset as numbers of a shape; NetCDF stores a single number as an array of one."""
    value = np.asarray(attributes[name])
    if value.dtype.kind not in "iuf" or value.size != math.prod(shape):
        raise ValueError(
            f"the dataset's attribute {name} must be {'a number' if shape == () else f'{shape[0]} numbers'}, "
            f"got {str(attributes[name])[:60]!r}"
        )
    return value.astype(np.float64).reshape(shape)
