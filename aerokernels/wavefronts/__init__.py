"""Wavefronts over a pupil: fitted terms, Zernike modes, point spread and transfer functions, exchange formats."""

from .point_spread import PointSpread, point_spread_function
from .result import Wavefront
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
