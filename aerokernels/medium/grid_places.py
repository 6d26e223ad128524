"""Positions of a uniform grid's nodes, on which results that depend only on them are cached for all fields."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..derived import Derived


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


def known(samples: Any, key: Hashable, make: Callable[[], Any], most: int) -> Any:
    """Return the result of `make()`, cached with the node positions of a grid that shares them with other grids.

    For other samples `make()` is called each time.

    Args:
        samples: The samples of a field; grids share positions by `UniformGrid.share_places`.
        key: Names the result, as in `Derived.derive`. A result that depends on node values needs them in its key.
        make: Computes the result.
        most: Greatest number of results of this kind that are cached, the latest.
    """
    places = getattr(samples, "shared_places", None)
    return make() if places is None else places.derive(key, make, most)
