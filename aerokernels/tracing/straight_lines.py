"""The straight lines of undisturbed rays through a part of a field, from their entry to their end.

Where a ray meets its stop at an angle to the normal, an error of its direction changes its optical path by the lever
arm: the distance to the stop times the tangent of that angle.
"""

from dataclasses import dataclass

import numpy as np

from ..derived import Derived, cached_on
from ..medium import Body, IndexField, SolidBody
from ..medium.grid import local_coordinates
from ..process.threads import in_turn, own_cores
from ..rays import RayBundle
from .lines import BOXES, crossing_of_box, span_of_box
from .scheme import LEAST_COSINE
from .stop import ArcLength, Plane, stop_distance

# Number of lines that are tested near a body, in addition to the outermost ones.
BESIDE_BODY = 192
# Lines that are searched together for the outermost ones.
CHUNK = 15 << 10  # speed only: larger arrays come as new pages


@dataclass(frozen=True, eq=False)
class Lines(Derived):
    """Straight lines through the support: starts [m] and unit vectors (n, 3), and lengths and lever arms [m], (n,).

    `tangent` is that of the angle with the stop's normal; 0 where there is no stop.
    """

    start: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    lever_arm: np.ndarray
    tangent: np.ndarray

    def every(self, step: int) -> "Lines":
        """Return every `step`-th line."""
        arrays = self.start, self.direction, self.length, self.lever_arm, self.tangent
        return Lines(*(array[::step] for array in arrays))


def lines_through(field: IndexField, rays: RayBundle, until, low: np.ndarray, high: np.ndarray) -> Lines:
    """Lines of the rays that meet the part of the field from `low` to `high` [m, along the field's own axes]."""
    grid = field.samples
    return _lines(rays, field.geometry, field.body, np.stack([low, high]), np.stack([grid.low, grid.high]), until)


@cached_on("rays", 4)
def _lines(
    rays: RayBundle, geometry: str, body: Body | SolidBody | None, part: np.ndarray, box: np.ndarray, until
) -> Lines:
    """As `lines_through`; `part` and the whole `box` are given by their corners along the field's own axes [m]."""
    p, d = rays.position, rays.direction
    if body is not None and len(p) > BESIDE_BODY:  # each line is tested against every segment of the body
        some = np.linspace(0, len(p) - 1, BESIDE_BODY).astype(int)
        rows = np.concatenate([some, outermost_rays(geometry, p, d, until, part[0], part[1])])
        p, d = p[rows], d[rows]
    enter, leave, _ = crossing_of_box(p, d, part[0], part[1], geometry)
    if body is not None:
        # A ray that begins inside the body is traced from where it leaves it.
        wall = body.crossings(p, d)
        inside = (np.count_nonzero(wall <= 0.0, axis=1) % 2).astype(bool)
        first = np.where(wall > 0.0, wall, np.inf).min(axis=1, initial=np.inf)
        enter = np.where(inside, np.maximum(enter, first), enter)
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(until, Plane):
            stop, cosine = ((until.point - p) @ until.normal) / (d @ until.normal), np.abs(d @ until.normal)
            stop = np.where(stop > 0.0, stop, np.inf)
            leave = np.minimum(leave, stop)
        else:
            _, stop, cosine = crossing_of_box(p, d, box[0], box[1], geometry)
        tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, LEAST_COSINE)
        tangent = np.where(np.isfinite(stop), tangent, 0.0)
        lever_arm = np.where(np.isfinite(stop), tangent * (stop - enter), 0.0)
    meets = (leave > enter) & np.isfinite(leave)
    start = p[meets] + enter[meets, None] * d[meets]
    return Lines(start, d[meets], (leave - enter)[meets], lever_arm[meets], tangent[meets])


def outermost(vectors: np.ndarray) -> np.ndarray:
    """Rows with the least and the greatest of each component of vectors (n, k), shape (2 k,)."""
    return np.ravel([(component.argmin(), component.argmax()) for component in vectors.T])


def outermost_rays(
    geometry: str, position: np.ndarray, direction: np.ndarray, until, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Rows of the rays outermost in position or direction, and of lines that begin or end so within a box.

    The box is given by its corners [m, along the field's own axes]; a line ends at the stop if that is inside. The
    longest line is among them.
    """

    def find(part: slice | np.ndarray) -> np.ndarray:
        # Component by component in memory, as they are used here: several times as fast as rows of three.
        p, d = position[part].T.copy(), direction[part].T.copy()
        rows = [outermost(p.T), outermost(d.T)]
        enter, leave = span_of_box(p.T, d.T, low, high, geometry)
        np.minimum(leave, stop_distance(p.T, d.T, until), out=leave)
        length = leave - enter
        meets = (length > 0.0) & np.isfinite(leave)
        if meets.any():
            some = slice(None) if meets.all() else np.flatnonzero(meets)
            p, d, enter, leave, length = p[:, some], d[:, some], enter[some], leave[some], length[some]
            found = [outermost(local_coordinates((p + at * d).T, geometry)) for at in (enter, leave)]
            inside = np.append(found, length.argmax())
            rows.append(inside if isinstance(some, slice) else some[inside])
        chosen = np.concatenate(rows)
        return part.start + chosen if isinstance(part, slice) else part[chosen]

    pieces = [slice(first, first + CHUNK) for first in range(0, len(position), CHUNK)]
    found = list(in_turn(find, pieces, own_cores()))
    return found[0] if len(found) == 1 else find(np.concatenate(found))


def local_range(lines: Lines, geometry: str) -> np.ndarray:
    """Least and greatest of the lines' coordinates along the grid's own axes, shape (2, d)."""
    ends = np.concatenate([lines.start, lines.start + lines.length[:, None] * lines.direction])
    local = local_coordinates(ends, geometry)
    low, high = local.min(axis=0), local.max(axis=0)
    if geometry == "axisymmetric":
        # Between its ends a line may come nearer to the axis.
        square = np.maximum((lines.direction[:, :2] ** 2).sum(axis=1), 1e-300)
        nearest = np.clip(-(lines.start[:, :2] * lines.direction[:, :2]).sum(axis=1) / square, 0.0, lines.length)
        low[0] = np.hypot(*(lines.start[:, :2] + nearest[:, None] * lines.direction[:, :2]).T).min()
    return np.stack([low, high])


@dataclass(frozen=True)
class LeverArms:
    """The greatest lengths over a bundle of undisturbed rays [m].

    Through the field's box, up to a stop in it; from there to the stop (`reach`); and that times the tangent of the
    angle with the stop's normal, of rays that do not graze it (LEAST_COSINE).
    """

    path_length: float
    reach: float
    lever_arm: float


def lever_arms_of(field: IndexField, rays: RayBundle, until) -> LeverArms | None:
    """The lever arms of a bundle up to its stop; None where no ray meets the field's box before it."""
    low, high = (np.asarray(corner, dtype=float)[0 if field.geometry == "volume" else 1 :] for corner in field.box)
    return _lever_arms(rays, field.geometry, low, high, until)


@cached_on("rays", BOXES)
def _lever_arms(rays: RayBundle, geometry: str, low: np.ndarray, high: np.ndarray, until) -> LeverArms | None:
    enter, leave, cosine = crossing_of_box(rays.position, rays.direction, low, high, geometry)
    stop = leave
    if isinstance(until, Plane):
        cosine = rays.direction @ until.normal
        height = (until.point - rays.position) @ until.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            stop = np.where(height * cosine > 0.0, height / cosine, np.inf)
    elif isinstance(until, ArcLength):
        cosine, stop = np.ones(len(leave)), np.full(len(leave), until.length)
    leave = np.minimum(leave, stop)
    good = (leave > enter) & np.isfinite(leave)
    if not good.any():
        return None
    reach = np.where(np.isfinite(stop), stop, leave)[good] - enter[good]
    steep = np.abs(cosine[good])
    tangent = np.sqrt(np.maximum(1.0 - steep**2, 0.0)) / np.maximum(steep, LEAST_COSINE)
    lever_arm = np.where((steep > LEAST_COSINE) & np.isfinite(stop[good]), reach * tangent, 0.0)
    return LeverArms(float((leave - enter)[good].max()), float(reach.max()), float(lever_arm.max()))


def obliquity(direction: np.ndarray, until) -> np.ndarray:
    """Return the vectors o (n, 3) for which a displacement x of a ray changes its path length to the stop by x . o.

    They are across the rays, as long as the tangent of the angle with the normal of a Plane, the only oblique stop.
    """
    if not isinstance(until, Plane):
        return np.zeros_like(direction)
    cosine = (direction @ until.normal)[:, None]
    steep = np.copysign(np.maximum(np.abs(cosine), LEAST_COSINE), cosine)
    return np.asarray((cosine * direction - until.normal) / steep)
