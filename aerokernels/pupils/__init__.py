"""Pupils: flat apertures with a transmission, and a map of the unit square for sampling."""

from .base import Pupil
from .disc import Annulus, Disc, area_below, unit_disc_samples
from .pixels import Mask, Rectangle
from .polygon import Polygon
from .square_map import SquareMap
from .vectors import as_unit_vector, as_vector, direction_of, transverse_axes

__all__ = [
    "Annulus",
    "Disc",
    "Mask",
    "Polygon",
    "Pupil",
    "Rectangle",
    "SquareMap",
    "area_below",
    "as_unit_vector",
    "as_vector",
    "direction_of",
    "transverse_axes",
    "unit_disc_samples",
]
