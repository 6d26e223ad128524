"""Coordinates of files and arrays: their usual names, and the axes that they belong to."""

from collections.abc import Mapping
from typing import TypeVar

Own = TypeVar("Own")

# In lower case, without blanks, punctuation and units.
COLUMNS = {
    "x": ("x", "points0", "coordinatex", "centersx", "ccx", "xcoordinate", "posx", "positionx"),
    "y": ("y", "points1", "coordinatey", "centersy", "ccy", "ycoordinate", "posy", "positiony"),
    "z": ("z", "points2", "coordinatez", "centersz", "ccz", "zcoordinate", "posz", "positionz"),
    "r": ("r", "radius"),
}
PLACE = {"x": 0, "y": 1, "z": 2, "r": 1}
# Directions of the axis of symmetry of a flow over r and z (the optical frame, z points upstream), or over r and x.
SYMMETRY = {"z": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0)}


def axes_of(known: Mapping[str, Own]) -> tuple[tuple[str, ...], tuple[float, float, float] | None]:
    """Return the coordinates of a flow in the order of its axes, and the axis of symmetry of one over r and z or x.

    Args:
        known: The coordinates that there are, by "x", "y", "z" and "r".
    """
    along = next((axis for axis in "zx" if axis in known), None)
    if "r" in known and "y" not in known and along is not None:
        return ("r", along), SYMMETRY[along]
    return tuple(axis for axis in "xyz" if axis in known), None
