"""Wavefronts over a pupil: fitted terms, Zernike modes, point spread and transfer functions, exchange formats."""

from importlib import import_module
from typing import TYPE_CHECKING

from .terms import (
    TERMS,
    TiltFit,
    check_metres,
    check_terms,
    check_wavefront,
    fit_tilt,
    map_points,
    mean_phasor,
    remove_terms,
    weighted_mean,
)

if TYPE_CHECKING:
    from .point_spread import PointSpread, point_spread_function
    from .result import Wavefront
    from .traced import wavefront
    from .transfer import EncircledEnergy, Transfer

__all__ = [
    "TERMS",
    "EncircledEnergy",
    "PointSpread",
    "TiltFit",
    "Transfer",
    "Wavefront",
    "check_metres",
    "check_terms",
    "check_wavefront",
    "fit_tilt",
    "map_points",
    "mean_phasor",
    "point_spread_function",
    "remove_terms",
    "wavefront",
    "weighted_mean",
]

# Modules that are imported when one of their names is first used.
_MODULE_OF = {
    "EncircledEnergy": "transfer",
    "PointSpread": "point_spread",
    "Transfer": "transfer",
    "Wavefront": "result",
    "point_spread_function": "point_spread",
    "wavefront": "traced",
}


def __getattr__(name: str):
    """Import a public name from its module."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
