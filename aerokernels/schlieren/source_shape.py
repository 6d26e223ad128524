"""Shape of a bench's source: the distribution of its light.

The source is a name or any pupil, of which only the shape counts, not the position and direction: its first axis is
across the knife edge (a shadowgraph's horizontal), its second along it. A mask's weights are amplitudes, as everywhere:
light is their square. Only `Pupil.coverage` of a shape is used, the light in the cells of a grid.
"""

import numpy as np

from ..inputs.checks import check_choice
from ..pupils import Disc, Pupil, Rectangle

SOURCES = ("slit", "disc", "square")
# Positions of an edge evaluated together.
BLOCK = 1 << 14  # speed only


def check_source(source: str | Pupil) -> None:
    """Check that `source` is a known name or a pupil.

    Raises:
        ValueError: The name is unknown.
    """
    if not isinstance(source, Pupil):
        check_choice(source, "source", SOURCES)


def shape_of(source: str | Pupil) -> Pupil | None:
    """Return the shape, of any size; None for a slit, which has no width along the edge."""
    if isinstance(source, Pupil):
        return source
    return Disc(1.0) if source == "disc" else Rectangle(2.0, 2.0) if source == "square" else None


def light_in(shape: Pupil, x_edges: np.ndarray, y_edges: np.ndarray) -> np.ndarray:
    """Return the light below positions on the first axis, in a strip between two positions on the second."""
    areas = np.diff(y_edges)[:, None] * np.diff(x_edges)
    return np.asarray(shape.coverage(x_edges, y_edges, 2) * areas)


def light_below(shape: Pupil, place: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the light below positions on the first axis, within a strip between two positions on the second."""
    reach = shape.half_extent[0]
    places = np.clip(np.ravel(place), -reach, reach)
    edges, where = np.unique(np.concatenate([[-reach], places]), return_inverse=True)
    light, strip = np.zeros(len(edges)), np.array([low, high])
    for first in range(0, len(edges) - 1, BLOCK):
        part = edges[first : first + BLOCK + 1]
        light[first + 1 : first + len(part)] = light_in(shape, part, strip)[0]
    return np.asarray(np.cumsum(light)[where[1:]].reshape(np.shape(place)))
