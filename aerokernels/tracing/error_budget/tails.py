r"""Estimate the disturbance beyond a point at which the known air ends, from the air just inside it.

A quantity q along a ray, at a depth x below the end of the known air, is assumed to continue beyond that end so that
its integral there is

    A0 = max q over 0 <= x <= s,   A1 = max q over s <= x <= 2 s
    max(a A0, q(0)) min(s / ln(A1 / A0), D, w)  the first of the three only where A1 > A0, where the disturbance decays

a is 1, or less at a face at which all the air fades out (face_shares.py). s is two cells, by their extent along the
ray; D is the box's own extent along the line, since air that does not decay is assumed to continue for the same length
again; w is the length of the path outside. With a = 1, an exponential tail has A0 s / ln(A1 / A0) left from the depth s
on, and a steeper one less.

For q = |m|, the contrast, that integral is an optical path. For q = |grad m . e| it is the angle by which the missing
air would have turned the ray, times the obliquity e of the ray's stop (lever_arms.py): the optical path changes by that
times the distance from the middle of that air to the stop.
"""

from itertools import product

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ..lever_arms import obliquity
from ..lines import box_size, box_span, cell_along
from .mesh_rim import rim_contrast

WINDOW_CELLS = 2.0
# An obliquity below this is rounding.
NO_OBLIQUITY = 1e-12
DEPTHS = np.array([0.0, 0.5, 1.0, 1.5, 2.0])  # over s; the middle one belongs to both windows


def path_beyond(field: IndexField, point, inward, chord, path, cell=None, contrast=None, share=1.0) -> np.ndarray:
    """Optical path beyond some points [m], over a length `path` [m] in the direction -inward, shape (n,).

    The other arguments are those of `contrast_tail`.
    """
    strength, scale = contrast_tail(field, point, inward, chord, cell, contrast, share)
    return np.asarray(strength * _length(field, scale, inward, path))


def drift_beyond(
    field: IndexField, point, inward, chord, path, until, distance, leaves, cell=None, share=1.0
) -> np.ndarray:
    """Change of optical paths to an oblique stop by the deflection in the air beyond some points [m], shape (n,).

    Args:
        field: The refractive index.
        point: Points of the boundary [m], shape (n, 3).
        inward: Unit vectors along the rays into the known air, shape (n, 3).
        chord: Length of the known air in that direction [m], shape (n,).
        path: Length of the path beyond [m], shape (n,).
        until: The stop.
        distance: From the points to the stop [m], shape (n,); rays for which that is not finite never meet it.
        leaves: Whether rays leave the known air there, or enter it; one for all, or of shape (n,).
        cell: Size of the cells there [m], shape (n,); None for the field's own.
        share: a of the points, shape (n,) or one for all.
    """
    lost = np.zeros(len(point))
    across = obliquity(inward, until)
    rows = np.flatnonzero((np.abs(across).max(axis=1, initial=0.0) > NO_OBLIQUITY) & np.isfinite(distance))
    if len(rows) == 0:
        return lost
    cell = None if cell is None else cell[rows]
    share = np.broadcast_to(share, len(point))[rows]
    strength, scale = slope_tail(field, point[rows], inward[rows], chord[rows], across[rows], cell, share)
    length = _length(field, scale, inward[rows], path[rows])
    middle = np.where(np.broadcast_to(leaves, len(point))[rows], -0.5, 0.5) * length
    lost[rows] = strength * length * np.maximum(distance[rows] + middle, 0.0)
    return lost


def contrast_tail(
    field: IndexField, point, inward, chord, cell=None, contrast=None, share=1.0
) -> tuple[np.ndarray, np.ndarray]:
    """max(a A0, q(0)) of |contrast|, and the decay length s / ln(A1 / A0) [m], infinite where there is no decay.

    Args:
        field: The refractive index.
        point: Points of the boundary [m], shape (n, 3).
        inward: Unit vectors into the known air, shape (n, 3).
        chord: Length of the known air in that direction [m], shape (n,).
        cell: Size of the cells there [m], shape (n,); None for the field's own.
        contrast: |contrast| at the points, shape (n,), where it is already known.
        share: a of the points, shape (n,) or one for all.
    """
    field, cell = _original(field, cell, inward)
    places, step = _places(point, inward, chord, cell)
    if field.is_uniform:
        found = np.abs(contrast_in(field, places.reshape(-1, 3))).reshape(places.shape[:2])
    else:
        found = np.abs(field.contrast_at(places.reshape(-1, 3))).reshape(places.shape[:2])
        # A point on the rim may be outside the mesh by rounding.
        none = np.flatnonzero(~(found[:, 0] > 0.0))
        if len(none):
            found[none, 0] = rim_contrast(field, point[none]) if contrast is None else contrast[none]
    return _falls_off(field, found, point, step, share)


def slope_tail(field: IndexField, point, inward, chord, across, cell=None, share=1.0) -> tuple[np.ndarray, np.ndarray]:
    """The same of |grad m . across| as `contrast_tail` of |contrast|; `across` is (n, 3)."""
    field, cell = _original(field, cell, inward)
    places, step = _places(point, inward, chord, cell)
    flat, along = places.reshape(-1, 3), np.repeat(across, len(DEPTHS), axis=0)
    if field.is_uniform:
        found = _slope_in(field, flat, along)
    else:
        found = np.sum(field.gradient_at(flat) * along, axis=1)
    return _falls_off(field, np.abs(found).reshape(places.shape[:2]), point, step, share)


def _original(field: IndexField, cell, inward: np.ndarray) -> tuple[IndexField, np.ndarray]:
    """The field from which this one was resampled, if it is kept, and the smaller of their cells along rays [m]."""
    if cell is None:
        cell = _cell(field, inward)
    while field.source is not None and field.source is not field:
        cell = np.minimum(_cell(field, inward), _cell(field.source, inward))
        field = field.source
    return field, cell


def _cell(field: IndexField, inward: np.ndarray) -> np.ndarray:
    """Length of rays within a cell [m], shape (n,); at most the cell's longest side."""
    return np.minimum(cell_along(field, inward), float(np.max(field.spacing)))


def _places(point, inward, chord, cell) -> tuple[np.ndarray, np.ndarray]:
    """Points below the boundary [m], shape (n, 5, 3), and s [m], shape (n,)."""
    step = WINDOW_CELLS * cell
    depth = np.minimum(step[:, None] * DEPTHS, chord[:, None])
    return point[:, None] + depth[..., None] * inward[:, None], step


def _falls_off(field: IndexField, found: np.ndarray, point, step, share) -> tuple[np.ndarray, np.ndarray]:
    """max(a A0, q(0)) and the decay length of a quantity q sampled at the depths, shape (n, 5)."""
    if field.body is not None and len(point):
        found[field.body.contains(field.local_coordinates(point))] = 0.0
    middle = len(DEPTHS) // 2
    last, before = found[:, : middle + 1].max(axis=1), found[:, middle:].max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where((before > last) & (last > 0.0), step / np.log(before / last), np.inf)
    return np.maximum(share * last, found[:, 0]), scale


def _length(field: IndexField, scale, inward, path) -> np.ndarray:
    """Effective length of the air beyond [m]: min(s / ln(A1 / A0), D, w)."""
    return np.minimum(np.minimum(scale, extent(field, inward)), np.maximum(path, 0.0))


def contrast_in(field: IndexField, points: np.ndarray) -> np.ndarray:
    """Contrast at points (n, 3) of a uniform grid, linear between its samples; beyond a face, its value at the face."""
    assert isinstance(field.samples, UniformGrid)
    return _linear(field.samples, field.local_coordinates(points))


def _slope_in(field: IndexField, points: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Grad m . along at points of a uniform grid, both (n, 3), from differences over one cell, within the box."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    local = field.local_coordinates(points)
    if field.geometry == "axisymmetric":
        radius = np.where(local[:, 0] > 0.0, local[:, 0], 1.0)
        along = np.stack([np.sum(points[:, :2] * along[:, :2], axis=1) / radius, along[:, 2]], axis=1)
    else:
        along = along[:, 1:] if field.geometry == "planar" else along
    slope = np.zeros(len(points))
    for axis, spacing in enumerate(grid.spacing):
        low, high = local.copy(), local.copy()
        low[:, axis] = np.maximum(local[:, axis] - 0.5 * spacing, grid.low[axis])
        high[:, axis] = np.minimum(local[:, axis] + 0.5 * spacing, grid.high[axis])
        # The difference is less than half a cell only where rounding puts a point outside the box.
        apart = np.maximum(high[:, axis] - low[:, axis], 0.25 * spacing)
        slope += along[:, axis] * (_linear(grid, high) - _linear(grid, low)) / apart
    return slope


def _linear(grid: UniformGrid, local: np.ndarray) -> np.ndarray:
    """Samples at points along the grid's axes, linear between nodes; beyond a face, the value at the face."""
    start = np.zeros(len(local), dtype=np.int64)
    shares, strides = [], np.array(grid.samples.strides) // grid.samples.itemsize
    for axis, (column, count) in enumerate(zip(local.T, grid.shape, strict=True)):
        place = np.clip((column - grid.origin[axis]) / grid.spacing[axis], 0.0, count - 1.0)
        cell = np.minimum(place.astype(np.int64), count - 2)
        start += strides[axis] * cell
        shares.append(place - cell)
    flat = grid.samples.ravel(order="K")  # in memory order, like the strides
    values = [flat[start + int(strides @ corner)] for corner in product((0, 1), repeat=len(shares))]
    for share in reversed(shares):  # the last axis varies first
        values = [low + share * (high - low) for low, high in zip(values[::2], values[1::2], strict=True)]
    return np.asarray(values[0])


def extent(field: IndexField, direction: np.ndarray) -> np.ndarray:
    """Length of the box along lines through its middle [m], at most its diagonal; directions (n, 3)."""
    low, high = field.box
    middle = np.zeros(3)
    ends = np.isfinite(high - low)
    middle[ends] = 0.5 * (low[ends] + high[ends])
    leave = box_span(field, np.broadcast_to(middle, direction.shape), direction).leave
    return np.minimum(2.0 * leave, box_size(field))
