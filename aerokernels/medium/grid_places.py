"""Where the nodes of a uniform grid lie: what follows from that alone serves all fields of other values on the grid."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..derived import Derived


@dataclass(frozen=True, eq=False)
class GridPlaces(Derived):
    """The places of a uniform grid's nodes, and what later stages have worked out of them.

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
    """What `make()` returns, kept with the places of a grid that shares them with others; elsewhere made each time.

    Args:
        samples: What a field holds; grids share places by `UniformGrid.share_places`.
        key: Names the result, as `Derived.derive` has it; no value that the nodes hold may be in it but in its key.
        make: Works it out.
        most: How many results of the kind are kept at most, the latest.
    """
    places = getattr(samples, "shared_places", None)
    return make() if places is None else places.derive(key, make, most)
