"""The polygonal pupil: its division into triangles, and the exact coverage of grid cells."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..display.shown import shown
from ..inputs.arguments import checked
from .base import Pupil, cell_shares
from .square_map import TRIANGLES, SquareMap, cumulative


@checked
@shown
@dataclass(frozen=True, eq=False)
class Polygon(Pupil):
    """A flat pupil bounded by straight edges.

    Attributes:
        vertices: Corners in order around the polygon, in either sense, as coordinates along the pupil's two axes from
            its centre [m], shape (n, 2), n at least 3.
        center: The point from which the corners are measured [m], shape (3,).
        normal: Direction in which the pupil looks (made a unit vector), shape (3,).

    Raises:
        ValueError: Fewer than three corners, corners that are not finite, edges that cross or enclose nothing; a centre
            or normal that is not three finite numbers.
    """

    vertices: np.ndarray
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    if TYPE_CHECKING:  # arrays are made of what is given

        def __init__(  # noqa: D107
            self, vertices: ArrayLike, center: ArrayLike = (0, 0, 0), normal: ArrayLike = (0, 0, 1)
        ) -> None: ...

    def __post_init__(self):
        """Check and make a read-only copy, counter-clockwise."""
        corner = np.array(self.vertices, dtype=np.float64)
        if corner.ndim != 2 or corner.shape[1] != 2 or len(corner) < 3 or not np.isfinite(corner).all():
            raise ValueError(f"the vertices of a Polygon must be finite, of shape (3 or more, 2), got {corner.shape}")
        # A corner that is given twice in a row, such as the last one of a closed ring, is one corner.
        corner = corner[np.any(corner != np.roll(corner, -1, axis=0), axis=1)]
        size = np.abs(corner - corner[:1]).max(initial=0.0)
        area = _signed_area(corner) if len(corner) else 0.0
        if not abs(area) > 1e-12 * size**2:
            raise ValueError("the vertices of a Polygon enclose nothing: they lie on a line, or edges cross")
        crossed = _first_crossing(corner)
        if crossed is not None:
            raise ValueError(
                f"edges {crossed[0]} and {crossed[1]} of the Polygon meet: give its corners in turn, so that no "
                "two edges cross"
            )
        corner = corner if area > 0.0 else corner[::-1].copy()
        corner.setflags(write=False)
        object.__setattr__(self, "vertices", corner)
        self._check_place()

    @property
    def area(self) -> float:
        """Area [m2]."""
        return _signed_area(self.vertices)

    @property
    def half_extent(self) -> tuple[float, float]:
        """Greatest distance from the centre along each of the axes [m]."""
        x, y = np.abs(self.vertices).max(axis=0)
        return float(x), float(y)

    @property
    def reach(self) -> float:
        """Distance of the farthest corner from the centre [m]."""
        return float(np.hypot(*self.vertices.T).max())

    @cached_property
    def square_map(self) -> SquareMap:
        """Map of the unit square onto the pupil, in units of `reach`."""
        corner, first, second = self._triangles
        area = 0.5 * np.abs(_cross(first, second))
        pieces = np.stack([corner, first, second], axis=1)
        return SquareMap(TRIANGLES, len(area), 0, np.concatenate([cumulative(area), pieces.ravel()]))

    @cached_property
    def _triangles(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corner and two edges of the triangles of the polygon, in units of `reach`, shape (triangle_count, 2) each."""
        corner = self.vertices / self.reach
        pieces = corner[np.array(_ears(corner))]
        return pieces[:, 0], pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]

    def coverage(self, x_edges: np.ndarray, y_edges: np.ndarray, power: int = 1) -> np.ndarray:
        """Return the exact fraction of each grid cell that is in the pupil: see `Pupil.coverage`."""
        # By Green's theorem the area left of x and below y is minus the sum over edges of the integral of
        # min(edge's y, y) dx.
        below = np.zeros((len(y_edges), len(x_edges)))
        for begin, end in zip(self.vertices, np.roll(self.vertices, -1, axis=0), strict=True):
            below -= _under_edge(begin, end, np.asarray(x_edges)[None, :], np.asarray(y_edges)[:, None])
        area = np.diff(np.diff(below, axis=0), axis=1)
        return cell_shares(area, x_edges, y_edges, float(np.abs(self.vertices).max()))

    def transmission(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return 1 where a line to the right crosses an odd number of edges, else 0: see `Pupil.transmission`."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        inside = np.zeros(x.shape, dtype=bool)
        for (x0, y0), (x1, y1) in zip(self.vertices, np.roll(self.vertices, -1, axis=0), strict=True):
            if y0 != y1:
                inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return np.where(inside, 1.0, 0.0)

    def _gauss(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a product rule on each triangle, regarded as a square with one side collapsed to a corner."""
        corner, first, second = self._triangles
        order = max(1, round(np.sqrt(count / len(corner))))
        node, weight = np.polynomial.legendre.leggauss(order)
        far, across = (axis.ravel() for axis in np.meshgrid(0.5 * (node + 1.0), 0.5 * (node + 1.0), indexing="ij"))
        share = 0.25 * np.outer(weight, weight).ravel() * 2.0 * far  # the Jacobian grows with `far` from the corner
        points = corner[:, None] + far[:, None] * (first[:, None] + across[:, None] * (second - first)[:, None])
        area = np.abs(_cross(first, second))
        weights = np.outer(area / area.sum(), share / share.sum())
        return points.reshape(-1, 2), weights.ravel()


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _signed_area(corner: np.ndarray) -> float:
    """Return the area, positive if the corners are counter-clockwise."""
    shifted = corner - corner.mean(axis=0)
    return 0.5 * float(_cross(shifted, np.roll(shifted, -1, axis=0)).sum())


def _first_crossing(corner: np.ndarray) -> tuple[int, int] | None:
    """Return two edges that are not neighbours and meet, or None."""
    count = len(corner)
    end = np.roll(corner, -1, axis=0)

    def side(a, b, c):
        return np.sign(_cross(b - a, c - a))

    for one in range(count):
        others = np.array([k for k in range(one + 2, count) if (k + 1) % count != one], dtype=int)
        if not len(others):
            continue
        p, q, a, b = corner[one], end[one], corner[others], end[others]
        meets = (side(p, q, a) * side(p, q, b) <= 0.0) & (side(a, b, p) * side(a, b, q) <= 0.0)
        # Collinear edges meet only if their extents overlap.
        low, high = np.minimum(p, q), np.maximum(p, q)
        meets &= ((np.maximum(a, b) >= low) & (np.minimum(a, b) <= high)).all(axis=1)
        if meets.any():
            return one, int(others[np.argmax(meets)])
    return None


def _ears(corner: np.ndarray) -> list[tuple[int, int, int]]:
    """Return the triangles of a simple counter-clockwise polygon, found by cutting off ears."""
    left = list(range(len(corner)))
    found = []
    while len(left) > 3:
        best, most = 0, -np.inf
        for place in range(len(left)):
            before, here, after = left[place - 1], left[place], left[(place + 1) % len(left)]
            a, b, c = corner[before], corner[here], corner[after]
            area = float(_cross(b - a, c - a))
            if area <= 0.0:
                continue
            others = corner[[k for k in left if k not in (before, here, after)]]
            inside = (_cross(b - a, others - a) > 0.0) & (_cross(c - b, others - b) > 0.0)
            inside &= _cross(a - c, others - c) > 0.0
            if inside.any():
                continue
            # Of all ears the one nearest to equilateral is cut, because thin triangles sample badly.
            shape = area / float(np.sum((b - a) ** 2) + np.sum((c - b) ** 2) + np.sum((a - c) ** 2))
            if shape > most:
                best, most = place, shape
        if most > -np.inf:
            found.append((left[best - 1], left[best], left[(best + 1) % len(left)]))
        # Without an ear the rest is a line without area, whose corners are removed one by one.
        del left[best]
    triangle = (left[0], left[1], left[2])
    a, b, c = corner[list(triangle)]
    return [*found, triangle] if float(_cross(b - a, c - a)) > 0.0 or not found else found


def _under_edge(begin: np.ndarray, end: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the integral of min(edge's y, y) over the edge's x up to `x`, signed by the edge's sense; broadcast."""
    (x0, y0), (x1, y1), sign = begin, end, 1.0
    if x0 > x1:
        (x0, y0), (x1, y1), sign = end, begin, -1.0
    if x1 == x0:
        return np.zeros(np.broadcast_shapes(x.shape, y.shape))
    stop = np.clip(x, x0, x1)
    slope = (y1 - y0) / (x1 - x0)

    def edge(a, b):
        return (b - a) * (y0 + slope * (0.5 * (a + b) - x0))

    if slope == 0.0:
        return sign * (stop - x0) * np.minimum(y0, y)
    meets = np.clip(x0 + (y - y0) / slope, x0, x1)  # where the edge passes the height y
    turn = np.minimum(meets, stop)
    if slope > 0.0:  # the edge first, then the line y
        return sign * (edge(x0, turn) + (stop - turn) * y)
    return sign * ((turn - x0) * y + edge(turn, stop))
