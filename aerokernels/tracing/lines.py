"""The straight lines of undisturbed rays: where they cross a field's box, its body and a part of it, and their ends.

A volume's box has six faces, a planar field's four (it has no ends in x), and an axisymmetric field's is a cylinder.
Where a ray meets its stop at an angle to the normal, an error of its direction changes its optical path by the lever
arm: the distance to the stop times the tangent of that angle.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..derived import Derived, cached_on
from ..medium import Body, IndexField, SolidBody
from ..medium.grid import local_coordinates
from ..process.threads import in_turn, own_cores
from ..rays import RayBundle
from .scheme import LEAST_COSINE
from .stop import ArcLength, Plane, greatest_contrast, stop_distance

# Names of the faces by number: 2 axis + (0 low, 1 high); the side of a cylinder is SIDE.
FACES = ("low x", "high x", "low y", "high y", "low z", "high z", "r")
SIDE = 6
# A line outside a face by less than this share of the box's size counts as running in the face: rounding.
ROUNDING = 1e-9
# Boxes of which a bundle caches something.
BOXES = 2  # speed only


@dataclass(frozen=True, eq=False)
class BoxSpan:
    """Where lines cross a box, forward of their starts: distances [m] and numbers of FACES, each of shape (n,).

    `enter` is 0 and `entry_face` -1 for a start inside, where `face_behind` is the face by which the line would enter;
    `leave` is less than `enter` for a line that misses the box, and `exit_face` -1 where it never leaves.
    """

    enter: np.ndarray
    leave: np.ndarray
    entry_face: np.ndarray
    exit_face: np.ndarray
    face_behind: np.ndarray

    @property
    def meets(self) -> np.ndarray:
        """Which lines meet the box, shape (n,)."""
        return self.leave >= self.enter


@cached_on("field")
def box_size(field: IndexField) -> float:
    """Diagonal of the field's box [m]; an axis without ends is ignored."""
    return _diagonal(*field.box)


def _diagonal(low: np.ndarray, high: np.ndarray) -> float:
    return float(np.linalg.norm(np.where(np.isfinite(high - low), high - low, 0.0)))


def cell_along(field: IndexField, direction: np.ndarray) -> np.ndarray:
    """Length of lines along unit vectors (n, 3) within a cell of the field [m], (n,); infinite where no cell ends."""
    spacing = np.asarray(field.spacing)
    first = {"volume": (), "planar": (np.inf,), "axisymmetric": (spacing[0],)}[field.geometry]
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.max(np.abs(direction) / [*first, *spacing], axis=1))


def box_span(field: IndexField, position: np.ndarray, direction: np.ndarray) -> BoxSpan:
    """Return where lines from `position` [m] along unit vectors `direction`, both (n, 3), cross the field's box."""
    return _span(position, direction, field.geometry, *field.box)


@cached_on("rays", BOXES)
def bundle_span(rays: RayBundle, geometry: str, low: np.ndarray, high: np.ndarray) -> BoxSpan:
    """Return where the undisturbed rays of a bundle cross a field's box, given by its corners in x, y, z [m]."""
    return _span(rays.position, rays.direction, geometry, low, high)


def _span(position: np.ndarray, direction: np.ndarray, geometry: str, low: np.ndarray, high: np.ndarray) -> BoxSpan:
    tolerance = ROUNDING * _diagonal(low, high)
    round_box = geometry == "axisymmetric"
    count = len(position)
    near, far = np.full(count, -np.inf), np.full(count, np.inf)
    near_face, far_face = np.full(count, -1), np.full(count, -1)

    def narrow(first: np.ndarray, last: np.ndarray, first_face, last_face) -> None:
        later, sooner = first > near, last < far
        near[later], far[sooner] = first[later], last[sooner]
        near_face[later] = np.broadcast_to(first_face, count)[later]
        far_face[sooner] = np.broadcast_to(last_face, count)[sooner]

    for axis in (2,) if round_box else (0, 1, 2):
        if not np.isfinite(low[axis]):
            continue
        rate = direction[:, axis]
        first, last = slab_span(position[:, axis], rate, low[axis], high[axis], tolerance)
        forward = rate > 0.0
        narrow(first, last, 2 * axis + np.where(forward, 0, 1), 2 * axis + np.where(forward, 1, 0))
    if round_box:
        narrow(*cylinder_span(position, direction, float(high[0]), tolerance), SIDE, SIDE)
    # A line in a face, or one that passes an edge outside by no more than rounding, meets the box there.
    with np.errstate(invalid="ignore"):  # the difference inf - inf of a miss is not a touch
        rounding = 2.0 * tolerance + 16.0 * np.finfo(np.float64).eps * np.abs(near)
        touched = (far < near) & (near - far <= rounding) & np.isfinite(near)
    far = np.where(touched, near, far)
    inside = near <= 0.0
    return BoxSpan(np.maximum(near, 0.0), far, np.where(inside, -1, near_face), far_face, near_face)


def slab_span(place: np.ndarray, rate: np.ndarray, low: float, high: float, tolerance: float = 0.0):
    """Where lines place + t rate enter and leave a slab, which is widened for lines along it; else (inf, -inf)."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        to_low, to_high = (low - place) / rate, (high - place) / rate
        first, last = np.minimum(to_low, to_high), np.maximum(to_low, to_high)
    still = rate == 0.0
    if still.any():
        aside = still & ((place < low - tolerance) | (place > high + tolerance))
        first = np.where(still, np.where(aside, np.inf, -np.inf), first)
        last = np.where(still, np.where(aside, -np.inf, np.inf), last)
    return first, last


def cylinder_span(position, direction, radius: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where lines enter and leave an endless cylinder about the z axis [m]; (inf, -inf) for a miss."""
    px, py, dx, dy = position[:, 0], position[:, 1], direction[:, 0], direction[:, 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        square = dx * dx + dy * dy
        middle = -(px * dx + py * dy) / square
        closest = np.hypot(px + middle * dx, py + middle * dy)
        half = np.sqrt(np.maximum((radius - closest) * (radius + closest), 0.0) / square)
    along = ~(square > 0.0)
    off = np.where(along, np.hypot(px, py), closest) > radius + tolerance
    first = np.where(along, -np.inf, middle - half)
    last = np.where(along, np.inf, middle + half)
    return np.where(off, np.inf, first), np.where(off, -np.inf, last)


def face_text(field: IndexField, face: int) -> str:
    """Describe a face in words, such as "z = 6 mm"."""
    low, high = field.box
    if face == SIDE:
        return f"r = {1e3 * high[0]:.6g} mm"
    return f"{'xyz'[face // 2]} = {1e3 * (high if face % 2 else low)[face // 2]:.6g} mm"


def _spans(
    p: np.ndarray, d: np.ndarray, low: np.ndarray, high: np.ndarray, geometry: str
) -> Iterator[tuple[int | None, np.ndarray, np.ndarray]]:
    """Yield for each of the field's own axes where lines enter and leave a box along it."""
    for k in range(len(low)):
        if geometry == "axisymmetric" and k == 0:
            yield None, *cylinder_span(p, d, float(high[0]), 0.0)
        else:
            axis = k + 3 - len(low)
            yield axis, *slab_span(p[:, axis], d[:, axis], low[k], high[k])


def span_of_box(p: np.ndarray, d: np.ndarray, low: np.ndarray, high: np.ndarray, geometry: str):
    """Return where rays enter and leave a box [m along them], given by its corners along the field's own axes."""
    enter, leave = np.zeros(len(p)), np.full(len(p), np.inf)
    for _, first, last in _spans(p, d, low, high, geometry):
        np.maximum(enter, first, out=enter)
        np.minimum(leave, last, out=leave)
    return enter, leave


def crossing_of_box(p: np.ndarray, d: np.ndarray, low: np.ndarray, high: np.ndarray, geometry: str):
    """Where rays enter and leave a box given by its corners along the field's axes [m], and the exit's cosine."""
    enter, leave, cosine = np.zeros(len(p)), np.full(len(p), np.inf), np.ones(len(p))
    for axis, first, last in _spans(p, d, low, high, geometry):
        if axis is None:
            with np.errstate(invalid="ignore", over="ignore"):  # for a line that never leaves it
                out = p[:, :2] + last[:, None] * d[:, :2]
                slope = np.abs((out * d[:, :2]).sum(axis=1)) / high[0]
        else:
            slope = np.abs(d[:, axis])
        enter, cosine = np.maximum(enter, first), np.where(last < leave, slope, cosine)
        leave = np.minimum(leave, last)
    return enter, leave, cosine


class NoRayMeetsField(ValueError):
    """A bundle of which no ray meets the field's box ahead of its start."""


@cached_on("rays", BOXES)
def is_any_meeting(rays: RayBundle, geometry: str, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether any ray of a bundle meets a field's box, given by its corners in x, y, z [m], ahead of its start."""
    if bundle_span(rays.pilot, geometry, low, high).meets.any():  # nearly always
        return True
    chunks = (rays.rows(slice(first, first + CHUNK)) for first in range(0, rays.ray_count, CHUNK))
    return any(bundle_span(chunk, geometry, low, high).meets.any() for chunk in chunks)


def check_meeting(field: IndexField, rays: RayBundle, what: str) -> None:
    """Reject a bundle of which no ray meets the field's box ahead of its start; a field without contrast is accepted.

    Raises:
        NoRayMeetsField: No ray meets the box; the message gives the positions of box and rays and says what to check.
    """
    low, high = field.box
    if is_any_meeting(rays, field.geometry, low, high) or greatest_contrast(field) == 0.0:
        return
    box = ", ".join(
        f"{axis} from {a:.4g} to {b:.4g} m" for axis, a, b in zip("xyz", low, high, strict=True) if np.isfinite(b - a)
    )
    place, along = rays.position.mean(axis=0), rays.direction.mean(axis=0)
    raise NoRayMeetsField(
        f"no {what} meets the field, whose box is {box}: the rays start about ({place[0]:.4g}, {place[1]:.4g}, "
        f"{place[2]:.4g}) m and go toward ({along[0]:.3g}, {along[1]:.3g}, {along[2]:.3g}); check the units (metres "
        "are expected), the direction and the position"
    )


def walls_along(field: IndexField, position: np.ndarray, direction: np.ndarray, end) -> tuple[np.ndarray, np.ndarray]:
    """Where straight lines through a field begin: 0, or where one leaves the body [m]; and which end on the body, (n,).

    Those enter it before they leave the field's box or reach `end` [m], or never leave it there. A line along x through
    planar air never leaves the field and is not counted.
    """
    assert field.body is not None
    span = box_span(field, position, direction)
    walls = field.body.crossings(position, direction)
    walls = np.pad(walls, ((0, 0), (0, 2)), constant_values=np.inf)
    before = np.count_nonzero((walls <= span.enter[:, None]) & np.isfinite(walls), axis=1)
    inside = before % 2 == 1
    rows = np.arange(len(walls))
    leaves, enters = walls[rows, before], walls[rows, before + inside]
    last = np.minimum(span.leave, end)
    ended = span.meets & (span.leave < 1e30) & ((enters <= last) | inside & (leaves > last))
    return np.where(inside, leaves, 0.0), ended


def after_body(body: Body | SolidBody, position: np.ndarray, direction: np.ndarray, enter: np.ndarray) -> np.ndarray:
    """Where lines enter [m], but those that begin inside a body not before they leave it, shape (n,)."""
    walls = body.crossings(position, direction)
    out = np.where(walls > 0.0, walls, np.inf).min(axis=1, initial=np.inf)
    return np.where(np.count_nonzero(walls <= 0.0, axis=1) % 2 == 1, np.maximum(enter, out), enter)


def meets_wall(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which straight rays end on the body, see `walls_along`, shape (n,)."""
    return walls_along(field, position, direction, np.inf)[1]


# Number of lines that are tested near a body, in addition to the outermost ones.
BESIDE_BODY = 192
# Lines that are examined together.
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
        enter = after_body(body, p, d, enter)
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
