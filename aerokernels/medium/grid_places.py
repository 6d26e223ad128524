"""Positions of a uniform grid's nodes, on which results that depend only on them are cached for all fields."""

from dataclasses import dataclass
from weakref import WeakValueDictionary

import numpy as np

from ..derived import Derived
from ..process.opened import OPENED


@dataclass(frozen=True, eq=False)
class GridPlaces(Derived):
    """The positions of a uniform grid's nodes, and the results that later stages have computed from them.

    Attributes:
        shape: Number of nodes along each axis.
        origin: Coordinates of the first node [m], shape (d,).
        spacing: Node spacing [m], shape (d,).
        even_first_axis: Mirror symmetry at the first node of axis 0.
    """

    shape: tuple[int, ...]
    origin: np.ndarray
    spacing: np.ndarray
    even_first_axis: bool


def places_of(shape: tuple[int, ...], origin: np.ndarray, spacing: np.ndarray, even_first_axis: bool) -> GridPlaces:
    """Return the positions of such nodes: one object for all grids that exist at the same time.

    The results cached on it live as long as one of these grids. The arguments are the attributes of GridPlaces.
    """
    in_use: WeakValueDictionary[tuple, GridPlaces] = OPENED.once("positions of nodes in use", WeakValueDictionary)
    key = shape, origin.tobytes(), spacing.tobytes(), even_first_axis
    return in_use.get(key) or in_use.setdefault(key, GridPlaces(shape, origin, spacing, even_first_axis))
