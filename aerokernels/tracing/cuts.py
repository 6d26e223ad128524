r"""Integrate the air that a field was cut from (`IndexField.source`), along rays outside the field's box.

    lost OPD = \int m_source ds

along the undisturbed line or, behind a field that displaces rays by more than a cell, the tangent at the traced end, by
three Gauss points a cell. Other faces are ends of the flow, where nothing is lost: a plan names those in disturbed air.
"""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..medium.mesh_samples import MeshSamples
from ..process.threads import in_threads
from ..rays import RayBundle
from .lines import FACES, ROUNDING, SIDE, box_size, box_span, bundle_span, face_text, meets_wall, walls_along
from .step_bound import greatest_turn
from .stop import ArcLength, Plane, stop_distance

# No ray is examined if the greatest possible loss is below this share of the tolerance, or of GREATEST_TOLERANCE [m] if
# that is less.
NOTHING = 0.1
GREATEST_TOLERANCE = 1e-9
# Places and weights of the three Gauss points in a cell from 0 to 1.
GAUSS = ((0.5 - np.sqrt(0.15), 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + np.sqrt(0.15), 5.0 / 18.0))
# Rays that a thread examines together, and cells in which it integrates together: its arrays fit a core's cache.
CHUNK, CELLS = 1 << 10, 1 << 15  # speed only
Ends = tuple[np.ndarray, np.ndarray]  # where rays ended [m] and their directions there, both (ray_count, 3)
# Parts of lines: rows of the rays, points [m] (k, 3), unit vectors (k, 3), and the distances from the points between
# which they lie [m], (k,) each.
Parts = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _axis_of(field: IndexField, face: int) -> tuple[int, bool] | None:
    """The axis of the samples that a face is across, and whether it is at the upper end; None where there is none."""
    if face == SIDE:
        return (0, True) if field.geometry == "axisymmetric" else None
    axis = face // 2 - (3 - len(field.samples.low))
    return (axis, face % 2 == 1) if axis >= (field.geometry == "axisymmetric") else None


def is_cut(field: IndexField, face: int) -> bool:
    """Whether a face of a field's box, by its number in FACES, is a cut through the air of the field's source."""
    source, place = field.source, _axis_of(field, face)
    if source is None or source is field or place is None:
        return False
    axis, upper = place
    own, whole = field.samples, source.samples
    beyond = whole.high[axis] - own.high[axis] if upper else own.low[axis] - whole.low[axis]
    return bool(beyond > ROUNDING * box_size(source))


@cached_on("field")
def air_beyond(field: IndexField) -> np.ndarray:
    """Greatest |contrast| of a field's source beyond each of FACES that is a cut; 0 at every other face."""
    return np.array([_greatest_beyond(field, face) if is_cut(field, face) else 0.0 for face in range(len(FACES))])


def _greatest_beyond(field: IndexField, face: int) -> float:
    """The greatest |value| of the source in the cells that lie beyond a face, at least partly."""
    found = _axis_of(field, face)
    assert field.source is not None and found is not None
    samples, (axis, upper) = field.source.samples, found
    place = (field.samples.high if upper else field.samples.low)[axis]
    if isinstance(samples, UniformGrid):
        node = (place - samples.origin[axis]) / samples.spacing[axis]
        part = slice(int(np.floor(node)), None) if upper else slice(0, int(np.ceil(node)) + 1)
        values = samples.samples[(slice(None),) * axis + (part,)]
        return float(max(values.max(), -values.min()))
    corners = samples.mesh.vertices[samples.mesh.cells, axis]
    cells = samples.mesh.cells[((corners > place) if upper else (corners < place)).any(axis=1)]
    return float(np.abs(samples.values[cells]).max(initial=0.0))


def may_lose(field: IndexField, tolerance: float) -> bool:
    """Whether any ray may lose more than a negligible part of the tolerance [m of OPD] by the cuts of a field's box."""
    return bool(air_beyond(field).max() > weakest_contrast(field, tolerance))


def weakest_contrast(field: IndexField, tolerance: float) -> float:
    """Greatest |contrast| beyond a cut for which no ray is examined; `tolerance` is the OPD error [m]."""
    return NOTHING * min(tolerance, GREATEST_TOLERANCE) / box_size(field.source or field)


def lost(
    field: IndexField,
    rays: RayBundle,
    until: Plane | ArcLength | None,
    ends: Ends | None = None,
    tolerance: float = GREATEST_TOLERANCE,
) -> np.ndarray:
    """The OPD that the source of a field has outside the field's box on each ray [m], signed, shape (ray_count,).

    Rays that end on a body lose nothing, nor those in air that cannot change a path by a tenth of the tolerance [m].
    `ends` are those of the traced rays; None takes straight lines.
    """
    found = np.zeros(rays.ray_count)
    if not may_lose(field, tolerance):
        return found
    strong = air_beyond(field) > weakest_contrast(field, tolerance)
    bent = False  # whether the field may displace rays by more than a cell: half the greatest turn times its size
    if ends is not None and isinstance(field.samples, UniformGrid):
        bent = 0.5 * greatest_turn(field.samples) * box_size(field) > float(field.spacing.min())

    def examine(first: int) -> None:
        rows = slice(first, first + CHUNK)
        here = (ends[0][rows], ends[1][rows]) if ends is not None and bent else None
        found[rows] = _lost_by(field, rays.position[rows], rays.direction[rows], until, here, strong)

    in_threads(examine, range(0, rays.ray_count, CHUNK))
    return found


def cuts_crossed(field: IndexField, rays: RayBundle) -> np.ndarray:
    """The face by which each undisturbed ray leaves a field's box, or else enters it, if it is a cut, else -1, (n,)."""
    span = box_span(field, rays.position, rays.direction)
    cut = np.append([is_cut(field, face) for face in range(len(FACES))], False)
    leaves = cut[span.exit_face] & span.meets
    return np.where(leaves, span.exit_face, np.where(cut[span.entry_face] & span.meets, span.entry_face, -1))


def _lost_by(field: IndexField, position, direction, until, ends: Ends | None, strong: np.ndarray) -> np.ndarray:
    """As `lost`, for some rays; `strong` says of each of FACES whether the air beyond it counts."""
    source = field.source
    assert source is not None
    counts = np.append(strong, False)  # the last is for face -1
    span, stop = box_span(field, position, direction), stop_distance(position, direction, until)
    enters = span.meets & counts[span.entry_face]
    leaves = span.meets & counts[span.exit_face] & (stop > span.leave)
    rows = np.flatnonzero(enters | leaves | ~span.meets)
    found = np.zeros(len(position))
    if not len(rows):
        return found
    whole = box_span(source, position[rows], direction[rows])
    first, last = whole.enter, np.minimum(whole.leave, stop[rows])
    if source.body is not None:
        begin, blocked = walls_along(source, position[rows], direction[rows], last)
        first, last = np.maximum(first, begin), np.where(blocked, -np.inf, last)
    parts: list[Parts] = []

    def add(chosen: np.ndarray, start: np.ndarray, end: np.ndarray) -> None:
        some = np.flatnonzero(chosen[rows] & (end > start) & np.isfinite(end))
        parts.append((rows[some], position[rows[some]], direction[rows[some]], start[some], end[some]))

    add(enters, first, np.minimum(last, span.enter[rows]))
    add(~span.meets, first, last)
    if ends is not None:
        bent, part = _behind(field, source, ends, until, strong)
        kept = ~np.isin(part[0], rows[np.isneginf(last)])
        parts.append(tuple(array[kept] for array in part))  # type: ignore[arg-type]
        leaves &= ~bent
    add(leaves, np.maximum(first, span.leave[rows]), last)
    for part in parts:
        np.add.at(found, part[0], _integrals(source, *part[1:]))
    return found


def _behind(field: IndexField, source: IndexField, ends: Ends, until, strong: np.ndarray) -> tuple[np.ndarray, Parts]:
    """The tangents at traced ends, from the box to the stop, and which rays' ways out of the box they are, (n,)."""
    # An end that is outside the box by less than this share of the box's size counts as lying on its face.
    margin = 1e-6 * box_size(field)
    back = box_span(field, ends[0] + margin * ends[1], -ends[1])
    leaves = back.meets & (back.entry_face >= 0)
    if until is not None:
        leaves &= back.enter > 2.0 * margin
    rows = np.flatnonzero(leaves & np.append(strong, False)[back.entry_face])
    way = ends[1][rows]
    start = ends[0][rows] - (back.enter[rows] - margin)[:, None] * way
    end = box_span(source, start, way).leave
    if until is not None:
        end = np.minimum(end, back.enter[rows] - margin)
    return back.meets if until is not None else leaves, (rows, start, way, np.zeros(len(rows)), np.maximum(end, 0.0))


def _integrals(source: IndexField, point, way, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Integrals of the contrast [m] along the lines point + t way, for t from `begin` to `end` [m], shape (n,)."""
    found = np.zeros(len(point))
    cells = np.ceil((end - begin) / float(np.min(source.spacing))).astype(np.int64)
    batch = np.cumsum(cells) // CELLS
    for rows in np.split(np.arange(len(point)), np.flatnonzero(np.diff(batch)) + 1):
        count = cells[rows]
        line = np.repeat(rows, count)
        number = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
        step = (end[line] - begin[line]) / np.maximum(cells[line], 1)
        for place, weight in GAUSS:
            along = begin[line] + (number + place) * step
            local = source.local_coordinates(point[line] + along[:, None] * way[line])
            found += np.bincount(line, weight * step * _contrast(source, local), len(found))
    return found


def _contrast(source: IndexField, local: np.ndarray) -> np.ndarray:
    """Contrast at local points (n, d) in the box of the field, shape (n,)."""
    samples = source.samples
    if isinstance(samples, UniformGrid):
        return np.asarray(samples.evaluate(np.clip(local, samples.low, samples.high))[0])
    return np.asarray(samples.evaluate(local, None, False)[0])


# Layers of samples at a face whose air is that at the face.
OUTERMOST = 2
# Rays through a mesh that are looked at, and places along each, between which the rim of the mesh is found.
MESH_RAYS, MESH_PLACES = 32, 128
RIM = "the rim of the mesh"


@cached_on("field")
def face_strengths(field: IndexField) -> np.ndarray:
    """Greatest |contrast| in the OUTERMOST layers of a uniform grid at each of FACES; 0 where there is no such face."""
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


@cached_on("field", 4)
def flow_ends(field: IndexField, rays: RayBundle, until, tolerance: float) -> str:
    """A sentence on the disturbed ends of the flow that straight rays cross; empty where they cross none.

    Air is disturbed if as much of it as the box is long would change a path by more than the tolerance [m].
    """
    if isinstance(field.samples, UniformGrid):
        found = _at_faces(field, rays, until)
    else:
        found = _at_rim(field, rays, until)
    found = {place: contrast for place, contrast in found.items() if contrast * box_size(field) > tolerance}
    if not found:
        return ""
    places, greatest = " and ".join(found), max(found.values())
    return (
        f"the flow ends with its box at {places}, where rays pass through air of a contrast up to {greatest:.2g}: the "
        "answer is that of the air in the box"
    )


def _at_faces(field: IndexField, rays: RayBundle, until) -> dict[str, float]:
    """Greatest |contrast| where rays cross each face of the box of a uniform grid that is an end of the flow."""
    span = bundle_span(rays, field.geometry, *field.box)
    stop = stop_distance(rays.position, rays.direction, until)
    crossed = [
        (span.entry_face, span.enter, span.meets & (span.entry_face >= 0) & (stop > span.enter)),
        (span.exit_face, span.leave, span.meets & (span.exit_face >= 0) & (stop >= span.leave)),
    ]
    found: dict[str, float] = {}
    for faces, along, crosses in crossed:
        for face in np.unique(faces[crosses]):
            if is_cut(field, int(face)):
                continue
            rows = np.flatnonzero(crosses & (faces == face))
            contrast = np.abs(_nearest(field, rays.position[rows] + along[rows, None] * rays.direction[rows]))
            if field.body is not None and contrast.any():
                contrast = contrast[~meets_wall(field, rays.position[rows], rays.direction[rows])]
            place = face_text(field, int(face))
            found[place] = max(found.get(place, 0.0), float(contrast.max(initial=0.0)))
    return found


def _nearest(field: IndexField, point: np.ndarray) -> np.ndarray:
    """Contrast at the nodes of a uniform grid nearest to points (n, 3), shape (n,)."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    node = np.rint((field.local_coordinates(point) - grid.origin) / grid.spacing).astype(np.int64)
    return np.asarray(grid.samples[tuple(np.clip(node, 0, np.array(grid.shape) - 1).T)], np.float64)


def _at_rim(field: IndexField, rays: RayBundle, until) -> dict[str, float]:
    """Greatest |contrast| where rays enter and leave a mesh, except at a body."""
    some = rays.rows(np.unique(np.linspace(0, rays.ray_count - 1, MESH_RAYS).astype(int)))
    span = bundle_span(some, field.geometry, *field.box)
    last = np.minimum(span.leave, stop_distance(some.position, some.direction, until))
    rows = np.flatnonzero(span.meets & (last > span.enter) & np.isfinite(last))
    share = (np.arange(MESH_PLACES) + 0.5) / MESH_PLACES
    along = span.enter[rows, None] + share * (last - span.enter)[rows, None]
    point = some.position[rows, None] + along[..., None] * some.direction[rows, None]
    local, shape, samples = field.local_coordinates(point.reshape(-1, 3)), along.shape, field.samples
    assert isinstance(samples, MeshSamples)
    contrast = np.abs(samples.evaluate(local, None, False)[0]).reshape(shape)
    outside = (samples.mesh.locate(local) < 0).reshape(shape)
    solid = np.zeros(shape, bool) if field.body is None else field.body.contains(local).reshape(shape)
    changes = (outside[:, 1:] != outside[:, :-1]) & ~solid[:, 1:] & ~solid[:, :-1]
    greatest = float(np.maximum(contrast[:, 1:], contrast[:, :-1])[changes].max(initial=0.0))
    # A ray that begins outside the box, or goes on beyond it, crosses the rim in the first or the last place.
    for column, crosses in ((0, span.entry_face[rows] >= 0), (-1, span.leave[rows] <= last[rows])):
        greatest = max(greatest, float(contrast[crosses, column].max(initial=0.0)))
    return {RIM: greatest}
