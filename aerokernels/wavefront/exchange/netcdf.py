"""Wavefronts as labelled datasets, for NetCDF files with CF attributes."""

from functools import partial
from typing import Any

import numpy as np

from ..data import SIGN_CONVENTION, WavefrontMap


def to_xarray(wavefront: WavefrontMap):
    """An xarray.Dataset of "opd", "weight" and "intensity" over (y, x); the OPD's error budget is read for it."""
    import xarray

    coordinate = wavefront.coordinate
    opd = {"units": "m", "long_name": "optical path difference", "sign_convention": SIGN_CONVENTION}
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
    if wavefront.pupil is not None:
        attributes["pupil"] = type(wavefront.pupil).__name__
        attributes["pupil_center"], attributes["pupil_normal"] = wavefront.pupil.center, wavefront.pupil.normal
    return xarray.Dataset(
        {
            "opd": (("y", "x"), wavefront.opd, opd),
            "weight": (
                ("y", "x"),
                wavefront.weight,
                {"units": "1", "long_name": "transmission of the amplitude, mean over the pixel"},
            ),
            "intensity": (("y", "x"), wavefront.intensity, {"units": "1", "long_name": "mean intensity in the pixel"}),
        },
        coords={
            name: (name, coordinate, {"units": "m", "long_name": f"{name} in the pupil, from its centre"})
            for name in ("x", "y")
        },
        attrs=attributes,
    )


def from_xarray(dataset) -> dict[str, Any]:
    """What makes the wavefront again, by the names of its attributes.

    Raises:
        ValueError: A dataset that is none of `to_xarray`, or of another sign.
    """
    lost = [name for name in ("opd", "weight") if name not in dataset] + [
        name for name in ("wavelength", "pixel", "sign_convention") if name not in dataset.attrs
    ]
    if lost:
        raise ValueError(f"the dataset is no wavefront of Wavefront.to_xarray: {', '.join(lost)} is missing")
    attributes = dataset.attrs
    if attributes["sign_convention"] != SIGN_CONVENTION:
        raise ValueError(f"the dataset's sign convention is {attributes['sign_convention']!r}, not {SIGN_CONVENTION!r}")
    error = float(attributes.get("opd_error", np.nan))
    return {
        "opd": np.asarray(dataset["opd"].transpose("y", "x")),
        "weight": np.asarray(dataset["weight"].transpose("y", "x")),
        "pixel": float(attributes["pixel"]),
        "wavelength": float(attributes["wavelength"]),
        "intensity": np.asarray(dataset["intensity"].transpose("y", "x")) if "intensity" in dataset else None,
        "radius": float(attributes["radius"]) if "radius" in attributes else None,
        "blocked": float(attributes.get("blocked", 0.0)),
        "removed": tuple(str(attributes.get("removed", "")).split()),
        "direction": np.asarray(attributes["direction"]) if "direction" in attributes else None,
        "budget": partial(dict, total=error) if np.isfinite(error) else None,
    }
