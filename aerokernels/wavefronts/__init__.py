"""Wavefronts over a pupil: fitted terms, Zernike modes, point spread and transfer functions, exchange formats."""

from typing import TYPE_CHECKING

from .. import attributes_of
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

__getattr__ = attributes_of(__name__, _MODULE_OF)
