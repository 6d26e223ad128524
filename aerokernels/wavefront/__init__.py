"""Wavefronts over a pupil and what they make of a focus: terms, pictures, modes, exchange."""

from .point_spread import PointSpread, point_spread_function
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
)

__all__ = [
    "TERMS",
    "PointSpread",
    "TiltFit",
    "check_metres",
    "check_terms",
    "check_wavefront",
    "fit_tilt",
    "map_points",
    "mean_phasor",
    "point_spread_function",
    "remove_terms",
]
