"""Pupils: flat apertures with a transmission, and a map of the unit square for sampling."""

from .base import Projected, Pupil, across_look, as_unit_vector, as_vector, direction_of, seen_along, transverse_axes
from .disc import Annulus, Disc, area_below, unit_disc_samples
from .pixels import Mask, Rectangle
from .polygon import Polygon
from .square_map import SquareMap

__all__ = [
    "Annulus",
    "Disc",
    "Mask",
    "Polygon",
    "Projected",
    "Pupil",
    "Rectangle",
    "SquareMap",
    "across_look",
    "area_below",
    "as_unit_vector",
    "as_vector",
    "direction_of",
    "seen_along",
    "transverse_axes",
    "unit_disc_samples",
]
