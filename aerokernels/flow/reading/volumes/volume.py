r"""Density fields of volumes: a uniform grid is kept, every other mesh is resampled to one.

Averages over uniform cells become values at their corners whose cubic spline keeps them, one axis at a time. The value
at the face between two cells is their mean minus a sum of differences of slopes on either side,

    v_(i+1/2) = (a_i + a_(i+1)) / 2 - sum_k c_k [ (a_(i+1+k) - a_(i+k)) - (a_(i+1-k) - a_(i-k)) ],

to the eighth order of the cell's size, next to the ends to the fourth. Beside a captured shock the mean of the two
cells remains: no continuous function keeps both averages and their range there. The deficit of the integral along a
row, due to ends and shocks, is distributed to the row's faces in proportion to the room that each has towards the
adjacent averages, so that the integral along every row is the row's sum, to rounding.

The error is estimated on rows of cells along z: beside a captured shock by the difference between a linear function
with each cell's average and the means at the cell's corners, in smooth flow by its change from cell to cell.
"""

from dataclasses import replace

import numpy as np

from aerokernels.flow.reading.dataset import SOLID, Block, ReadError, grid_of, with_all_points
from aerokernels.flow.reading.volumes.point_values import LEAST_SHARE, lesser
from aerokernels.flow.reading.volumes.reconstruction import LINES, VolumeResampling, unresolved
from aerokernels.flow.reading.volumes.resampling import Resampling
from aerokernels.flow.reading.volumes.solids import corner_chunks
from aerokernels.flow.sampled_density import GridDensity
from aerokernels.medium import spline
from aerokernels.medium.averages.vertex_values import SHOCK_SHARE
from aerokernels.medium.labelled_grid import unevenness
from aerokernels.process.threads import in_threads


def volume_field(reading, shared=None) -> GridDensity:
    """Return the density of a volume on a uniform grid; `shared` keeps the map from its mesh to its grid."""
    dataset, path = reading.dataset, reading.path
    if len(dataset.blocks) == 1 and reading.options["spacing"] is None and reading.options["region"] is None:
        grid = uniform_grid(reading, *reading.densities[0])
        if grid is not None:
            return _on_uniform_grid(reading, *grid)
    dataset = with_all_points(dataset)
    densities = [(np.asarray(own, np.float64), where) for own, where in reading.densities]
    reading = replace(reading, dataset=dataset, densities=densities)
    moved = [reading.moved(block.points) for block in dataset.blocks]
    for block in dataset.blocks:
        if block.cells is None and block.shape is None:
            raise ReadError(
                path, f"block {block.name!r} has points and no cells", "give a file with cells, or a grid's shape"
            )
    if not any(block.cells is None or np.isin(block.cells.types, SOLID).any() for block in dataset.blocks):
        raise ReadError(path, "it has no solid cells: a surface in space", "give the volume's mesh")
    reading = replace(reading, dataset=replace(dataset, blocks=[cells_blanked(block) for block in dataset.blocks]))
    result = None if shared is None else shared.resampling
    if result is None or not result.fits(reading):
        result = Resampling(reading, moved)
        if shared is not None:
            shared.resampling = result
    return result.field(reading)


def _on_uniform_grid(reading, density: np.ndarray, low, step, measured) -> GridDensity:
    ambient = reading.options["ambient_density"] or float(np.median(density[:, :, -1]))
    provenance = f"{reading.path}: {'; '.join([*reading.described(), f'ambient {ambient:.6g} kg/m3'])}"
    composition = None
    if (fractions := reading.fractions) is not None:
        rho, where = reading.densities[0]
        partial = np.stack([uniform_grid(reading, rho * own, where)[0] for own in fractions.blocks[0]])
        composition = fractions.composition(partial, partial[..., -1].mean(axis=(1, 2)))
    return GridDensity(
        density, low, step, "volume", ambient, provenance=provenance, resampling=measured, composition=composition
    )


def cells_blanked(block: Block) -> Block:
    """Return the block with blanked points converted to blanked cells: cells with a blanked corner."""
    blank = block.blank
    if blank is None or len(blank) == block.cell_count:
        return block
    if not blank.any():
        return replace(block, blank=None)
    hidden = np.zeros(block.cell_count, bool)
    for chunk in corner_chunks(block):
        hidden[chunk.cell] = blank[chunk.corners].any(axis=0)
    return replace(block, blank=hidden)


def uniform_grid(reading, density: np.ndarray, where: str):
    """Return density [x, y, z], first node and spacing of a single block on a uniform grid, and its error; or None.

    Cell averages become values at the corners of the cells, and the error is that of this conversion. Values at nodes
    have the error None: the error budget estimates that of their interpolation.
    """
    block = reading.dataset.blocks[0]
    if block.shape is None or min(block.shape) < 2 or (block.blank is not None and block.blank.any()):
        return None
    if (grid := grid_of(block.points)) is not None:  # each edge is like all others along it
        edges, layers = [reading.moved(edge) for edge in grid.edges()], []
    else:
        at = reading.moved(block.points).reshape(*block.shape[::-1], 3)
        edges, layers = [at[0, 0], at[0, :, 0], at[:, 0, 0]], list(at)
    steps = [(edge[-1] - edge[0]) / (count - 1) for edge, count in zip(edges, block.shape, strict=True)]
    along = [int(np.argmax(np.abs(step))) for step in steps]
    if sorted(along) != [0, 1, 2]:
        return None
    size = np.array([abs(step[axis]) for step, axis in zip(steps, along, strict=True)])
    if (size <= 0.0).any():
        return None
    if not _is_even(edges, layers, [step[axis] * np.eye(3)[axis] for step, axis in zip(steps, along, strict=True)]):
        return None
    cell = where == "cell"
    counts = [n - 1 if cell else n for n in block.shape]
    if cell and min(counts) < 2:
        return None
    values = density.reshape(counts[::-1]).transpose(2, 1, 0)  # [i, j, k]
    values = np.transpose(values, [along.index(axis) for axis in range(3)])
    first, step = np.empty(3), np.empty(3)
    for i, axis in enumerate(along):
        step[axis] = size[i]
        first[axis] = min(edges[i][0, axis], edges[i][-1, axis])
        if steps[i][axis] < 0.0:
            values = np.flip(values, axis)
    if not cell:
        density = np.array(values, np.float64, order="C")
        density.setflags(write=False)  # a density field does not copy a read-only array
        return density, first, step, None
    values = np.asarray(values, np.float64)
    density, smooth = at_corners(values)
    return density, first, step, estimated_error(values, smooth, step)


def _is_even(edges: list[np.ndarray], layers: list[np.ndarray], steps: list[np.ndarray]) -> bool:
    """Return whether points on the edges of a grid, and in its layers [j, i] if any, have constant steps along them."""
    lines = [np.arange(len(edge))[:, None] * step for edge, step in zip(edges, steps, strict=True)]
    outermost = layers[:: max(len(layers) - 1, 1)] or [edge[[0, -1]] for edge in edges]
    uneven = unevenness(min(np.abs(step).max() for step in steps), max(float(np.abs(own).max()) for own in outermost))
    plane = edges[0][0] + (lines[0][None] + lines[1][:, None])
    pairs = [(edge, edge[0] + line) for edge, line in zip(edges, lines, strict=True)]
    return all((np.abs(own - place) <= uneven).all() for own, place in pairs) and all(
        (np.abs(layer - (plane + more)) <= uneven).all() for layer, more in zip(layers, lines[2], strict=False)
    )


# The c_k for one and for three slopes on either side: M F = 1 + O(w^4) and O(w^8) for a wave exp(i w x / h), with M the
# mean over a cell of the spline through values F exp(i w x / h) at the faces.
NEAR = 1.0 / 12.0
FAR = (239.0 / 1728.0, -29.0 / 864.0, 7.0 / 1728.0)


def at_corners(average: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values at the corners of uniform cells, one node more along each axis, and which cells are smooth."""
    smooth = kept = _smooth(average)
    for axis in range(average.ndim):
        average = _along(average, smooth, axis)
        before, after = ([(end if k == axis else (0, 0)) for k in range(smooth.ndim)] for end in ((1, 0), (0, 1)))
        smooth = np.pad(smooth, before, mode="edge") & np.pad(smooth, after, mode="edge")
    return average, kept


def _smooth(values: np.ndarray) -> np.ndarray:
    """Return which cells neither contain a captured shock nor touch a cell that does."""
    from scipy.ndimage import maximum_filter

    jump, bound = np.zeros(values.shape, bool), SHOCK_SHARE * np.ptp(values)
    for axis in range(values.ndim):
        if values.shape[axis] > 2:
            np.moveaxis(jump, axis, 0)[1:-1] |= np.abs(np.diff(np.moveaxis(values, axis, 0), 2, axis=0)) > bound
    return ~np.asarray(maximum_filter(jump, 3))


def _along(average: np.ndarray, smooth: np.ndarray, axis: int) -> np.ndarray:
    """Return values at the faces across one axis; threads process slabs of rows."""
    shape = list(average.shape)
    shape[axis] += 1
    result = np.empty(shape)
    weight = integral_weights(shape[axis])
    across = 1 if axis == 0 else 0
    size = max(1, (1 << 20) * average.shape[across] // max(average.size, 1))

    def work(first: int) -> None:
        part = tuple(slice(first, first + size) if k == across else slice(None) for k in range(average.ndim))
        own, flags, faces = (np.moveaxis(each[part], axis, 0) for each in (average, smooth, result))
        faces[:] = _at_faces(np.ascontiguousarray(own), flags, weight)

    in_threads(work, range(0, average.shape[across], size))
    return result


def integral_weights(count: int) -> np.ndarray:
    """Return the weights of `count` node values, one spacing apart, in the integral of their spline over all nodes."""
    coefficient = spline.spline_along(np.eye(count), 0, False)
    pieces = np.array([1.0, 11.0, 11.0, 1.0]) / 24.0
    return sum(piece * coefficient[k : k + count - 1].sum(axis=0) for k, piece in enumerate(pieces))


def _at_faces(average: np.ndarray, smooth: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return values at the n + 1 faces of n cells along the first axis."""
    faces = np.empty((len(average) + 1, *average.shape[1:]))
    np.add(average[1:], average[:-1], out=faces[1:-1])
    faces[1:-1] *= 0.5
    _bend(faces[1:-1], average, smooth)
    for edge, near in ((0, slice(None)), (-1, slice(None, None, -1))):
        _set_edge(faces[near], average[near], smooth[edge])
    _keep_sum(faces, average, weight)
    return faces


def _bend(inner: np.ndarray, average: np.ndarray, smooth: np.ndarray) -> None:
    """Subtract the differences of slopes from the means of neighbours, shape (n - 1, ...), where both are smooth."""
    slope, least = np.diff(average, axis=0), LEAST_SHARE * np.minimum(average[1:], average[:-1])
    if len(slope) < 2:
        return
    free, reach = smooth[1:] & smooth[:-1], len(FAR)
    first, last = 2.0 * slope[0] - slope[1], 2.0 * slope[-1] - slope[-2]  # extrapolated slopes, of a parabola
    if len(slope) > 2:
        first, last = first + slope[0] - 2.0 * slope[1] + slope[2], last + slope[-1] - 2.0 * slope[-2] + slope[-3]
    beyond = np.concatenate([first[None], slope, last[None]])
    bend = NEAR * (beyond[2:] - beyond[:-2])
    count = len(slope) - 2 * reach
    if count > 0:
        wide = sum(
            share * (slope[reach + k : reach + k + count] - slope[reach - k : reach - k + count])
            for k, share in enumerate(FAR, start=1)
        )
        far = free[reach:-reach] & free[reach - 1 : -reach - 1] & free[reach + 1 : len(free) - reach + 1]
        np.copyto(bend[reach:-reach], wide, where=far)
    np.copyto(inner, np.maximum(inner - bend, least), where=free)


def _set_edge(faces: np.ndarray, average: np.ndarray, smooth: np.ndarray) -> None:
    """Set the first face: that of the cubic with the first cell's average, or beside a shock by the lesser change."""
    own = average[0]
    if len(average) < 3:  # two cells cannot tell a slope from a jump
        faces[0] = own
        return
    weights = (24.0 / 9.0, -19.0 / 9.0, 5.0 / 9.0, -1.0 / 9.0)  # of the cubic through average and three faces
    cubic = sum(share * (each - own) for share, each in zip(weights, (own, *faces[1:4]), strict=True))
    faces[0] = np.maximum(
        own + np.where(smooth, cubic, 0.5 * lesser(own - average[1], average[1] - average[2])), LEAST_SHARE * own
    )


def _keep_sum(faces: np.ndarray, average: np.ndarray, weight: np.ndarray) -> None:
    """Move faces within the range of their cells so that the integral along each row is the sum of its averages."""
    low, high = np.minimum(average[1:], average[:-1]), np.maximum(average[1:], average[:-1])
    # Differences from the row's first average keep the digits of a nearly uniform density.
    lacks = (average - average[0]).sum(axis=0) - np.tensordot(weight, faces - average[0], axes=1)
    room = np.maximum(np.where(lacks > 0.0, high - faces[1:-1], faces[1:-1] - low), 0.0)
    slack = np.tensordot(weight[1:-1], room, axes=1)
    faces[1:-1] += np.clip(lacks / np.where(slack > 0.0, slack, 1.0), -0.5, 0.5) * room


def estimated_error(average: np.ndarray, smooth: np.ndarray, step: np.ndarray) -> VolumeResampling:
    """Return the error of columns along z through the spline that keeps averages over uniform cells.

    `average` [kg/m3] and `smooth` cells, beside no captured shock, are [x, y, z]; `step` is the cells' size [m].
    """
    i, j = (np.unique(((np.arange(LINES) + 0.5) / LINES * n).astype(np.int64)) for n in average.shape[:2])
    # [row in x, its side, row in y, its side, z]; cells beyond the edge are extrapolated linearly from the last two
    padded = np.pad(average, 1, mode="reflect", reflect_type="odd")
    near = padded[i[:, None, None, None] + np.arange(3)[:, None, None], j[:, None] + np.arange(3)]
    deficit = _deficits(near)
    free = smooth[i][:, j]
    change = np.zeros(deficit.shape)
    if deficit.shape[-1] > 2:
        change[..., 1:-1] = np.diff(deficit, 2, axis=-1)
        change[..., 0], change[..., -1] = change[..., 1], change[..., -2]
    lacks = np.where(free, change, deficit).reshape(-1, deficit.shape[-1])
    cell = np.broadcast_to(np.arange(lacks.shape[1]), lacks.shape)
    likely, greatest = unresolved(lacks * step[2], lacks, cell, float(np.ptp(average)))
    return VolumeResampling(
        tuple(float(size) for size in step),  # type: ignore[arg-type]
        *(0.0,) * 7,
        float(np.sqrt(np.mean(lacks**2))),
        float(np.sqrt(np.mean(likely**2))),
        float(greatest.max()),
    )


def _deficits(near: np.ndarray) -> np.ndarray:
    """Return the differences of linear functions in cells from means at their corners: see `CrossedCells.evaluate`."""
    corner = near
    for axis in (1, 3):
        moved = np.moveaxis(corner, axis, 0)
        corner = np.moveaxis(0.5 * (moved[1:] + moved[:-1]), 0, axis)
    corner = 0.5 * (corner[..., 1:] + corner[..., :-1])
    corner = np.stack([corner[..., :-1], corner[..., 1:]], axis=-1)  # the corners below and above each cell
    own = near[:, 1, :, 1, 1:-1]
    differ = own[:, None, :, None, :, None] - corner
    for axis in (1, 3, 5):
        slope = np.diff(corner.mean(axis=tuple({1, 3, 5} - {axis}), keepdims=True), axis=axis)
        shape = [2 if k == axis else 1 for k in range(6)]
        differ = differ + slope * np.array([-0.5, 0.5]).reshape(shape)
    rms = np.sqrt(np.mean(differ**2, axis=(1, 3, 5)))
    return np.copysign(rms, differ.mean(axis=(1, 3, 5)))
