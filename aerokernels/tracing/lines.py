"""Cross straight lines with the box of a field: where each line enters and leaves it, and through which face.

A volume's box has six faces, a planar field's four (it has no ends in x), and an axisymmetric field's is a cylinder.
Bundles of which no ray meets the field are refused here, and lines that end on the field's body are found.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle

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


CHUNK = 1 << 14


class NoRayMeetsField(ValueError):
    """A bundle of which no ray meets the field's box ahead of its start."""


def greatest_contrast(field: IndexField) -> float:
    """Greatest |contrast| of the field's samples."""
    if isinstance(field.samples, UniformGrid):
        low, high = field.samples.extremes
        return max(high, -low)
    values = field.samples.values
    return field.samples.derive("greatest contrast", lambda: float(max(values.max(), -values.min())))


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


def meets_wall(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which straight rays end on the body, see `walls_along`, shape (n,)."""
    return walls_along(field, position, direction, np.inf)[1]
