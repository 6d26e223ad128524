"""Tell where rays pass through disturbed air at faces of a field's box that are ends of its flow.

The box is the whole flow there: the optical path of a ray is that of the air in the box, without an error for air
beyond it. A box of turbulence that is not faded out is the usual case; the plan of a trace says it in a sentence, so
that a face that was meant to lie in undisturbed air is seen.
"""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..medium.mesh_samples import MeshSamples
from ..rays import RayBundle
from .cuts import is_cut
from .lines import FACES, SIDE, box_size, bundle_span, face_text
from .meeting import meets_wall
from .stop import stop_distance

# Layers of samples at a face whose air is that at the face.
OUTERMOST = 2
# Rays through a mesh that are looked at, and places along each, between which the rim of the mesh is found.
MESH_RAYS, MESH_PLACES = 32, 128
# Bundles for which a field caches the sentence.
CACHED = 4  # speed only
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


@cached_on("field", CACHED)
def flow_ends(field: IndexField, rays: RayBundle, until, tolerance: float) -> str:
    """A sentence on the disturbed ends of the flow that straight rays cross; empty where they cross none.

    Air is disturbed if as much of it as the box is long would change a path by more than the tolerance [m].

    Args:
        field: The refractive index.
        rays: Some of the rays, a few hundred.
        until: Their stop; None for rays that continue without end.
        tolerance: Requested OPD error [m].
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
