"""Synthetic schlieren pictures, shadowgraphs and interferograms of a field, and measurements on them."""

from .bench import Bench
from .fringes import Interferogram, interferogram
from .knife_edge import SchlierenImage, schlieren
from .line_of_sight import LineOfSight, line_of_sight
from .measurements import ShockAngle, StandOff, measure_shock_angle, measure_stand_off
from .picture import HalfComparison, Picture, compare_halves, read_picture, write_picture
from .shadowgraph import Shadowgraph, shadowgraph

__all__ = [
    "Bench",
    "HalfComparison",
    "Interferogram",
    "LineOfSight",
    "Picture",
    "SchlierenImage",
    "Shadowgraph",
    "ShockAngle",
    "StandOff",
    "compare_halves",
    "interferogram",
    "line_of_sight",
    "measure_shock_angle",
    "measure_stand_off",
    "read_picture",
    "schlieren",
    "shadowgraph",
    "write_picture",
]
