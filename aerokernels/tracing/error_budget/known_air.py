r"""Estimate the optical path that each ray may lose where the known air ends.

Outside its samples a field is ambient. Where the air at a face of the box (or at the rim of a mesh) is still disturbed,
the real air continues beyond that face, and the optical path of a ray that crosses it includes the known part only. The
loss is estimated on straight lines from the air just inside the face (tails.py). It is the optical path through the
missing air and, where the stop is a plane at an angle to the ray, the deflection by that air times the lever arm up to
the stop (lever_arms.py). A ray that passes beside the box, no farther away than the box is large, may lose as much as a
ray that leaves through the nearest point of the box, reduced by the decay between that point and the ray.

Where a field may displace rays by more than a cell, and where the traced ends are known, straight lines from those ends
back to the box are taken instead of undisturbed lines.

If all faces of a box are undisturbed, no ray is examined. The known air does not end at a wall, at the axis, or in x in
a planar field. Air that fades out smoothly at a whole face ends there, not only its samples do: face_shares.py.

For a resampled field, its source decides whether the air at a face is disturbed: errors of a grid that is too coarse,
in undisturbed air beside a shock layer, are resampling errors and count as such.
"""

from dataclasses import dataclass

import numpy as np

from ...derived import cached_on
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...process.threads import in_threads
from ...rays import RayBundle
from ..lever_arms import lever_arms_of, obliquity
from ..lines import BOXES, FACES, SIDE, box_size, box_span, bundle_span
from ..prediction import greatest_turn
from ..stop import ArcLength, Plane, stop_distance
from .face_shares import face_shares, face_toward
from .mesh_rim import mesh_crossings, mesh_rim
from .tails import extent, lost_beyond, tails

# No ray is examined if the greatest possible loss is below this share of the tolerance, or of GREATEST_TOLERANCE [m] if
# that is less.
NOTHING = 0.1
GREATEST_TOLERANCE = 1e-9
# An end that is outside the box by less than this share of the box's size counts as lying on its face.
ON_FACE = 1e-6
# Layers of samples at a face whose air is that at the face.
OUTERMOST = 2
# Rays that are examined together: their arrays fit a core's cache.
CHUNK = 1 << 13  # speed only
# Places along a ray that passes beside the box, over twice the box's size. A ray runs along a face if at least
# PLACES_ALONG of them are at one distance from the box.
PLACES_BESIDE, PLACES_ALONG = 16, 3
Ends = tuple[np.ndarray, np.ndarray]  # where rays ended [m] and their directions there, both (ray_count, 3)
BESIDE = -1  # in place of a face, for a ray that passes beside the box or crosses the rim of a mesh


@dataclass(frozen=True, eq=False)
class KnownAir:
    """The OPD that some rays may lose where the known air ends, computed on request.

    Attributes:
        field: The refractive index.
        rays: The rays.
        until: Their stop.
        tolerance: Requested OPD error [m].
    """

    field: IndexField
    rays: RayBundle
    until: Plane | ArcLength | None
    tolerance: float

    def lost(self, ends: Ends | None = None) -> np.ndarray:
        """OPD that each ray may have lost [m], (ray_count,); `ends` are traced end points [m] and directions."""
        return may_be_lost(self.field, self.rays, self.until, self.tolerance, self.needed(ends))[0]

    def needed(self, ends: Ends | None) -> Ends | None:
        """Return traced ends where straight lines do not suffice: the answer depends on the requested outputs there."""
        return ends if ends is not None and may_bend(self.field) else None


def may_bend(field: IndexField) -> bool:
    """Whether a field on a uniform grid may displace rays by more than a cell; False for every field on a mesh.

    The displacement is at most half the greatest turn times the box's size.
    """
    if not isinstance(field.samples, UniformGrid):
        return False
    return 0.5 * greatest_turn(field.samples) * box_size(field) > float(field.spacing.min())


def face_strengths(field: IndexField) -> np.ndarray:
    """Greatest |contrast| in the OUTERMOST layers of samples at each of FACES; 0 where the field has no such face.

    For a mesh the last entry is that of its rim.
    """
    if not isinstance(field.samples, UniformGrid):
        return np.append(np.zeros(len(FACES) - 1), mesh_rim(field).strength.max(initial=0.0))
    return field.derive("face strengths", lambda: _find_face_strengths(field))


def _find_face_strengths(field: IndexField) -> np.ndarray:
    found = np.zeros(len(FACES))
    samples = field.samples.samples
    first_axis = 3 - samples.ndim
    for axis in range(samples.ndim):
        for side, layers in enumerate((range(OUTERMOST), range(-OUTERMOST, 0))):
            # One by one: NumPy is slow along axes of two entries.
            outermost = [np.abs(samples[(slice(None),) * axis + (layer,)]).max() for layer in layers]
            found[2 * (first_axis + axis) + side] = max(outermost)
    if field.geometry == "axisymmetric":
        found[SIDE], found[:4] = found[3], 0.0
    return found


def may_be_lost(
    field: IndexField, rays: RayBundle, until, tolerance: float, ends: Ends | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """OPD that each ray may lose [m] where the known air ends, and the face with the greatest loss, both (ray_count,).

    Args:
        field: The refractive index.
        rays: The rays.
        until: Their stop; None for rays that continue without end once they have left the field.
        tolerance: Requested OPD error [m].
        ends: Where the traced rays ended [m] and their directions there, both (ray_count, 3), if known; otherwise rays
            are assumed to be straight.
    """
    lost, face = np.zeros(rays.ray_count), np.full(rays.ray_count, BESIDE)
    strongest = face_strengths(field).max()
    if not strongest > 0.0:
        return lost, face
    weakest = weakest_contrast(field, tolerance) / (1.0 + _direction_weight(field, rays, until))
    if not strongest > weakest:
        return lost, face
    crossed = faces_crossed(field, rays) if until is None and ends is None else None
    if crossed is not None and not face_strengths(field)[crossed].max(initial=0.0) > weakest:
        return lost, face

    def look_at(first: int) -> None:
        rows = slice(first, first + CHUNK)
        here = None if ends is None else (ends[0][rows], ends[1][rows])
        bundle = rays if rays.ray_count <= CHUNK else rays.rows(rows)
        span = bundle_span(bundle, field.geometry, *field.box)
        given = field, rays.position[rows], rays.direction[rows]
        lost[rows], face[rows] = _lost_by(*given, span, until, here, weakest)

    in_threads(look_at, range(0, rays.ray_count, CHUNK))
    return lost, face


def weakest_contrast(field: IndexField, tolerance: float) -> float:
    """Greatest |contrast| at a face for which no ray without a stop is examined; `tolerance` is the OPD error [m]."""
    return NOTHING * min(tolerance, GREATEST_TOLERANCE) / box_size(field)


def faces_crossed(field: IndexField, rays: RayBundle) -> np.ndarray | None:
    """Numbers of the faces at which undisturbed rays enter and leave the box of a field on a uniform grid.

    None if a ray passes beside it, for more rays than CHUNK, and on a mesh.
    """
    if not field.is_uniform or rays.ray_count > CHUNK:
        return None
    return _faces_crossed(rays, field.geometry, *field.box)


@cached_on("rays", BOXES)
def _faces_crossed(rays: RayBundle, geometry: str, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    span = bundle_span(rays, geometry, low, high)
    faces = np.union1d(span.entry_face, span.exit_face)
    return faces[faces >= 0] if span.meets.all() else None


def _direction_weight(field: IndexField, rays: RayBundle, until) -> float:
    """The loss by missing deflections over the loss of optical path: at most the lever arm over a cell.

    It only decides whether the air is disturbed enough to matter, so a part of the rays is sufficient.
    """
    some = rays[:: -(-rays.ray_count // CHUNK)] if isinstance(until, Plane) and rays.ray_count else None
    lever_arms = None if some is None else lever_arms_of(field, some, until)
    return 0.0 if lever_arms is None else lever_arms.lever_arm / float(np.min(field.spacing))


def _lost_by(field, position, direction, span, until, ends, weakest: float) -> tuple[np.ndarray, np.ndarray]:
    """OPD that each of some rays may lose [m], and the face with the greatest loss; `span` is their span of the box."""
    stop = stop_distance(position, direction, until)
    lost, face = np.zeros(len(position)), np.full(len(position), BESIDE)

    def add(rows, point, inward, chord, path, faces, distance, leaves: bool) -> None:
        if not len(rows):
            return
        share = face_shares(field)[faces]
        amount = lost_beyond(field, point, inward, chord, path, until, distance, leaves, share=share)
        face[rows] = np.where(amount > lost[rows], faces, face[rows])
        lost[rows] += amount

    if field.is_uniform:
        strong = face_strengths(field) > weakest
        entering = np.flatnonzero(span.meets & (span.entry_face >= 0) & (stop > span.enter) & strong[span.entry_face])
        enter = span.enter[entering]
        chord = span.leave[entering] - enter
        point = position[entering] + enter[:, None] * direction[entering]
        rest = stop[entering] - enter
        add(entering, point, direction[entering], chord, enter, span.entry_face[entering], rest, leaves=False)
        for rows, point, inward, chord, path, faces in _exits(
            field, position, direction, span, stop, until, ends, strong
        ):
            add(rows, point, inward, chord, path, faces, distance=path, leaves=True)
    else:
        found = mesh_crossings(field, position, direction, stop, weakest)
        chord = np.full(len(found.ray), np.inf)
        leaves = np.sum(found.inward * direction[found.ray], axis=1) < 0.0
        distance = np.array(found.path)
        distance[~leaves] = stop[found.ray[~leaves]] - found.path[~leaves]
        given = field, found.point, found.inward, chord, found.path, until, distance, leaves
        np.add.at(lost, found.ray, lost_beyond(*given, found.cell, found.contrast))
    aside = np.flatnonzero(~span.meets | (stop <= span.enter) & (span.enter > 0.0))
    lost[aside] = _beside(field, position[aside], direction[aside], stop[aside], until)
    return lost, face


def _exits(field, position, direction, span, stop, until, ends, strong: np.ndarray):
    """Yield for rays that leave the box: rows, exit points, directions back, chords, path lengths outside, faces.

    Only faces with disturbed air, `strong` by the number of the face, are examined. Where the traced ends are known,
    straight lines from the ends back to the box are used.
    """
    margin = ON_FACE * box_size(field)
    straight = span.meets & (span.exit_face >= 0) & (stop > span.leave + margin)
    if ends is not None:
        beyond = ends[0] + margin * ends[1]
        back = box_span(field, beyond, -ends[1])
        outside = back.meets & (back.entry_face >= 0) & span.meets
        if until is not None:
            outside &= back.enter > 2.0 * margin
        rows = np.flatnonzero(outside & strong[back.entry_face])
        point = beyond[rows] - back.enter[rows, None] * ends[1][rows]
        path = np.full(len(rows), np.inf) if until is None else back.enter[rows] - margin
        chord = back.leave[rows] - back.enter[rows]
        yield rows, point, -ends[1][rows], chord, path, back.entry_face[rows]
        straight &= ~(outside if until is None else back.meets)
    rows = np.flatnonzero(straight & strong[span.exit_face])
    point = position[rows] + span.leave[rows, None] * direction[rows]
    chord, path = span.leave[rows] - span.enter[rows], stop[rows] - span.leave[rows]
    yield rows, point, -direction[rows], chord, path, span.exit_face[rows]


def _beside(field: IndexField, position, direction, stop, until) -> np.ndarray:
    """OPD that rays beside the box may lose [m], estimated at the point of the box that they pass nearest, shape (n,).

    A ray along a face passes many points at one distance. The strongest air among them is taken, over a length reduced
    by the ratio of their mean to it.
    """
    if len(position) == 0:
        return np.zeros(0)
    size = box_size(field)
    along = np.zeros(len(position))
    for _ in range(24):  # alternating projections on the line and on the box
        nearest = _into_box(field, position + along[:, None] * direction)
        along = np.clip(np.sum((nearest - position) * direction, axis=1), 0.0, stop)
    length = np.minimum(extent(field, direction), stop)
    along, length = _strongest(field, position, direction, stop, along, length)
    place = position + along[:, None] * direction
    nearest = _into_box(field, place)
    distance = np.linalg.norm(nearest - place, axis=1)
    lost = np.zeros(len(position))
    rows = np.flatnonzero(distance <= size)
    inward = (nearest - place)[rows] / np.maximum(distance[rows], 1e-300)[:, None]
    chord = np.full(len(rows), np.inf)
    share = face_shares(field)[face_toward(field, (place - nearest)[rows])] if field.is_uniform else 1.0
    across = obliquity(direction[rows], until) if isinstance(until, Plane) else None  # else met at a right angle
    contrast, *slope = tails(field, nearest[rows], inward, chord, across, share=share)
    lost[rows] = contrast.strength * np.exp(-distance[rows] / contrast.scale) * length[rows]
    for tail in slope:
        rest = np.where(np.isfinite(stop[rows]), stop[rows] - along[rows], 0.0)
        lost[rows] += tail.strength * np.exp(-distance[rows] / tail.scale) * length[rows] * rest
    return lost


def _strongest(field: IndexField, position, direction, stop, along, length) -> tuple[np.ndarray, np.ndarray]:
    """For rays along a face: where the air there is strongest, and the length over which it counts [m], both (n,).

    Other rays keep their place `along` and their `length`.
    """
    begin = np.maximum(along - box_size(field), 0.0)
    step = (np.minimum(along + box_size(field), stop) - begin) / PLACES_BESIDE
    place = position + along[:, None] * direction
    farthest = np.linalg.norm(_into_box(field, place) - place, axis=1) + float(np.min(field.spacing))
    found = np.zeros((PLACES_BESIDE, len(position)))
    beside = np.zeros(found.shape, dtype=bool)
    for k in range(PLACES_BESIDE):
        place = position + (begin + (k + 0.5) * step)[:, None] * direction
        nearest = _into_box(field, place)
        beside[k] = np.linalg.norm(nearest - place, axis=1) <= farthest
        rows = np.flatnonzero(beside[k])
        found[k, rows] = np.abs(_roughly(field, nearest[rows]))
    greatest = found.max(axis=0, initial=0.0)
    many = beside.sum(axis=0)
    counts = (many >= PLACES_ALONG) & (greatest > 0.0)
    best = begin + (found.argmax(axis=0) + 0.5) * step
    shared = length * found.sum(axis=0) / np.where(counts, many * greatest, 1.0)
    return np.where(counts, best, along), np.where(counts, shared, length)


def _roughly(field: IndexField, point: np.ndarray) -> np.ndarray:
    """Contrast at the nodes nearest to some points, or on a mesh at the points, shape (n,)."""
    grid = field.samples
    if not isinstance(grid, UniformGrid):
        return np.asarray(field.contrast_at(point))
    node = np.rint((field.local_coordinates(point) - grid.origin) / grid.spacing).astype(np.int64)
    return np.asarray(grid.samples[tuple(np.clip(node, 0, np.array(grid.shape) - 1).T)])


def _into_box(field: IndexField, point: np.ndarray) -> np.ndarray:
    """The point of the box nearest to each point, both (n, 3)."""
    low, high = field.box
    if field.geometry != "axisymmetric":
        return np.clip(point, low, high)
    radius = np.hypot(point[:, 0], point[:, 1])
    shrink = np.minimum(1.0, high[0] / np.maximum(radius, 1e-300))
    return np.stack([point[:, 0] * shrink, point[:, 1] * shrink, np.clip(point[:, 2], low[2], high[2])], axis=1)
