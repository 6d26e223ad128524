"""The shape of a bench's source: how much of its light comes from where.

A name, or any pupil, whose shape counts and whose place and direction do not: its first axis lies across the knife edge
(a shadowgraph's horizontal), its second along it. A mask's weights are amplitudes, as everywhere: light is their
square. All that is asked of a shape is `Pupil.coverage`, the light in the cells of a grid.
"""

import numpy as np

from ..inputs.checks import check_choice
from ..pupils import Disc, Pupil, Rectangle

SOURCES = ("slit", "disc", "square")
# Places of an edge that are looked up at once.
BLOCK = 1 << 14  # speed only


def check_source(source: str | Pupil) -> None:
    """Refuse what is no shape of a source.

    Raises:
        ValueError: An unknown name.
    """
    if not isinstance(source, Pupil):
        check_choice(source, "source", SOURCES)


def shape_of(source: str | Pupil) -> Pupil | None:
    """The shape, of any size; None of a slit, which has no width along the edge."""
    if isinstance(source, Pupil):
        return source
    return {"slit": None, "disc": Disc(1.0), "square": Rectangle(2.0, 2.0)}[source]


def light_in(shape: Pupil, x_edges: np.ndarray, y_edges: np.ndarray) -> np.ndarray:
    """Light from the cells of a grid, ascending, in the shape's own lengths, shape (y count, x count)."""
    areas = np.diff(y_edges)[:, None] * np.diff(x_edges)
    return np.asarray(shape.coverage(x_edges, y_edges, 2) * areas)


def light_below(shape: Pupil, place: np.ndarray, low: float, high: float) -> np.ndarray:
    """Light from below places along the first axis, in a strip between two places along the second; of their shape."""
    reach = shape.half_extent[0]
    places = np.clip(np.ravel(place), -reach, reach)
    edges, where = np.unique(np.concatenate([[-reach], places]), return_inverse=True)
    light, strip = np.zeros(len(edges)), np.array([low, high])
    for first in range(0, len(edges) - 1, BLOCK):
        part = edges[first : first + BLOCK + 1]
        light[first + 1 : first + len(part)] = light_in(shape, part, strip)[0]
    return np.asarray(np.cumsum(light)[where[1:]].reshape(np.shape(place)))
