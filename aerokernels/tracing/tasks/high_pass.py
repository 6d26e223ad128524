"""The part of a field's potential that samples H apart along a ray do not resolve: a high pass on its grid.

A component of frequency f [1/m] has along a unit vector u at most phi = min(|f|, sum |u_i| f_i) and counts from about
phi = edge / H on. A spline whose nodes oscillate at v < 1/2 cycles a cell has the share B(v) of it, B(v + m) at images,

    B(v) = 3 (sin(pi v) / (pi v))^4 / (2 + cos(2 pi v)).

About faces that rays run along values are continued oddly and faded out, so that no kink counts: no ray goes there.
"""

import math

import numpy as np

from aerokernels.medium.grid import UniformGrid
from aerokernels.process.threads import in_threads, own_cores, slabs
from aerokernels.tracing.step_bound import potential_at_nodes

# Axes on which phi H over cycles a cell is smaller do not count; images count along axes on which it is above the
# second.
LEAST_ALONG, LEAST_IMAGED = 0.01, 0.8


def high_pass(
    grid: UniformGrid,
    steepness: np.ndarray,
    spacing: float,
    edge: float,
    is_fine: bool,
) -> np.ndarray:
    """The potential over the ambient index without low frequencies along the rays [1], for samples `spacing` [m] apart.

    `steepness` are greatest components of their unit vectors along the grid's axes. Components pass from a frequency of
    about `edge` / spacing on. Without `is_fine` rounding to single precision is not visible.
    """
    from scipy.fft import dctn, idctn

    kind = np.result_type(grid.samples.dtype if is_fine else np.float32)  # float32 samples are rounded as much
    rates = steepness * spacing / grid.spacing  # phi H over cycles a cell
    axes = [axis for axis, count in enumerate(grid.shape) if count > 1 and rates[axis] > LEAST_ALONG]
    if not axes:
        return np.zeros(grid.shape, kind)

    beside = [axis for axis in axes if axis != int(np.argmax(rates))]
    whole, inner = continued(grid, beside, kind)
    how = {"axes": axes, "overwrite_x": True, "workers": own_cores()}  # all in the memory of one volume
    found = dctn(whole, 1, **how)
    _weigh(found, rates, axes, spacing / grid.spacing[axes], edge)
    return np.asarray(idctn(found, 1, **how)[inner])


def _weigh(values: np.ndarray, rates: np.ndarray, axes: list[int], steps: np.ndarray, edge: float) -> None:
    """Multiply values by the weights of the cosines along some axes; `steps` are H in cells."""
    shape = values.shape
    # Frequencies of the cosines of a type I transform, in cycles a cell, along the axes.
    cycles = []
    for axis in axes:
        count = shape[axis]
        line = [count if other == axis else 1 for other in range(len(shape))]
        cycles.append((np.arange(count) / (2.0 * (count - 1))).reshape(line))
    first = axes[0]

    def fill(rows: slice) -> None:
        place = (slice(None),) * first + (rows,)
        values[place] *= _shares_at([cycles[0][place], *cycles[1:]], rates[axes], steps, edge, values.dtype)

    in_threads(fill, slabs(shape[first], math.prod(shape)))


def _shares_at(
    cycles: list[np.ndarray], rates: np.ndarray, steps: np.ndarray, edge: float, kind: np.dtype
) -> np.ndarray:
    """The weights at some frequencies [cycles a cell], one array along each axis; `steps` are H in cells."""
    share = np.zeros((), kind)
    rest = np.ones((), kind)  # the share that is in no image
    for imaged, image in (*_images(rates), (None, 0)):
        square, along, weight = np.zeros((), kind), np.zeros((), kind), np.ones((), kind)
        for number, (rate, step) in enumerate(zip(rates, steps, strict=True)):
            here = np.abs(cycles[number] + image) if number == imaged else cycles[number]
            square = square + ((step * here) ** 2).astype(kind)
            along = along + (rate * here).astype(kind)
            if imaged is not None and rate > LEAST_IMAGED:
                weight = weight * _held_share(here).astype(kind)
        weight, rest = (rest, rest) if imaged is None else (weight, rest - weight)
        along *= along
        np.minimum(square, along, out=square)
        share = share + weight * _share_left(square, edge)
    return share


def _share_left(square: np.ndarray, edge: float) -> np.ndarray:
    """The share of components of this (phi H)^2 that is passed."""
    # The share of a component that is passed at phi H = x is 1 - exp(-(x / edge)^24): for edge = 0.92 it is 0.03 at x =
    # 0.8 and 0.99 at x = 0.98.
    over = np.minimum(square * square.dtype.type(edge**-2), square.dtype.type(2.0))
    # With lower edges it is 1 - exp(-(x / edge)^3), which grows like the error of a rule of fourth order at a line's
    # end.
    if edge < 0.5:
        over = over * np.sqrt(over)
    else:
        over *= over
        over *= over
        over = over * over * over
    np.negative(over, out=over)
    np.expm1(over, out=over)
    return np.negative(over, out=over)


def _images(rates: np.ndarray) -> list[tuple[int, int]]:
    """Axes, and along each the numbers m of the images that count; images along two axes at once do not."""
    main = int(np.argmax(rates))
    near = [(number, -1) for number, rate in enumerate(rates) if rate > LEAST_IMAGED]
    # Cells between samples from which on the nearest image is the only one that they do not resolve.
    return [*near, (main, 1), (main, -2)] if rates[main] < 1.35 else near


def _held_share(cycles: np.ndarray) -> np.ndarray:
    """B: the share of a cosine with these cycles a cell in a cubic spline through nodes, also for an image."""
    return 3.0 * np.sinc(cycles) ** 4 / (2.0 + np.cos(2.0 * np.pi * cycles))


# Cells behind a face in which values fade to that at the face, which has no slope at the new end.
WIDTH = 4
# A face is left as it is where its slopes are no more than this share of its second differences, as on a plane of
# symmetry, or of the greatest value: an even continuation then has the weaker kink.
AS_ON_SYMMETRY, NO_SLOPE = 0.5, 1e-6


def continued(grid: UniformGrid, axes: list[int], kind: np.dtype) -> tuple[np.ndarray, tuple[slice, ...]]:
    """Continue the potential over the ambient index beyond faces across some axes; also the slices of the grid's."""
    least = NO_SLOPE * float(np.abs(grid.potential_of(np.array(grid.extremes))).max()) / grid.ambient_index
    inner, shape = [slice(0, count) for count in grid.shape], list(grid.shape)
    for axis in axes:
        is_even = axis == 0 and grid.even_first_axis
        first = 0 if is_even or not _has_slope(grid, axis, (0, 1, 2), least) else WIDTH
        last = WIDTH if _has_slope(grid, axis, (-1, -2, -3), least) else 0
        inner[axis] = slice(first, first + grid.shape[axis])
        shape[axis] += first + last
    whole = np.empty(shape, kind)
    own = whole[tuple(inner)]

    def fill(rows: slice) -> None:
        own[rows] = potential_at_nodes(grid, rows)

    in_threads(fill, slabs(len(own), own.size))
    for number, axis in enumerate(axes):
        # What is behind the faces across the next axes is not there yet.
        part = whole[
            tuple(slice(None) if at not in axes[number:] or at == axis else inner[at] for at in range(whole.ndim))
        ]
        rows = np.moveaxis(part, axis, 0)
        _fill(rows[: inner[axis].stop], inner[axis].start)
        _fill(rows[inner[axis].start :][::-1], len(rows) - inner[axis].stop)
    return whole, tuple(inner)


def _has_slope(grid: UniformGrid, axis: int, layers: tuple[int, int, int], least: float) -> bool:
    """Whether the potential has slopes at a face across an axis, by the layers of nodes there."""
    if grid.shape[axis] <= WIDTH:
        return False
    rows = [potential_at_nodes(grid, (slice(None),) * axis + (layer,)) for layer in layers]
    slope = np.abs(1.5 * rows[0] - 2.0 * rows[1] + 0.5 * rows[2]).max()
    second = np.abs(rows[0] - 2.0 * rows[1] + rows[2]).max()
    return bool(slope > max(AS_ON_SYMMETRY * second, least))


def _fill(rows: np.ndarray, count: int) -> None:
    """Fill the first `count` rows, behind a face, from those that follow."""
    for node in range(1, count + 1):
        part = node / count
        faded = rows.dtype.type((1.0 - part) ** 2 * (1.0 + 2.0 * part))
        rows[count - node] = rows[count] + faded * (rows[count] - rows[count + node])
