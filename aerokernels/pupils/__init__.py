"""Pupils: flat apertures with a transmission, and a map of the unit square for sampling."""

from .base import Pupil
from .disc import Annulus, Disc, area_below, unit_disc_samples
from .pixels import Mask, Rectangle
from .polygon import Polygon
from .projected import Projected, across_look, seen_along
from .square_map import SquareMap
from .vectors import as_unit_vector, as_vector, direction_of, transverse_axes

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
