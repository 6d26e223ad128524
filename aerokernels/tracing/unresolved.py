r"""What a field holds between even samples, block by block, so that no ray passes it unseen.

The midpoint rule with samples H apart errs, on a line along which the potential is f, by

    E = sum over k != 0 of (-1)^k F(k / H)

with F the Fourier transform of f: by what the line holds at frequencies of 1 / H and above. No estimate from the
samples themselves sees it, and neither do other rays (a pilot) that pass beside it: the bound comes from the field.

It is split once into a part of low frequencies along the rays, on which the rule converges faster than any power of H,
and a remainder R, both even about the faces, as an axisymmetric field is about its axis. A component of frequency f
[1/m] has along a unit vector u at most the frequency

    phi = min(|f|, sum |u_i| f_i),     in r and z: f_r sqrt(u_x^2 + u_y^2) + f_z |u_z|

(cos(2 pi f sqrt(b^2 + t^2)) is an entire function of t of that type, so that this holds off the axis too), and is part
of R from about phi = 0.9 / H on. The rule errs on R by no more than 2 int |R| dt along the ray.

Samples h apart make a spline that holds, of what oscillates between them at f h cycles a cell, the share B(f h) at f
and the share B(f h + m) at each image f + m / h,

    B(v) = 3 (sin(pi v) / (pi v))^4 / (2 + cos(2 pi v)),

and that is what counts: B falls off fast, above all where H is one to two cells, beyond what the nodes resolve.

Where all rays run along one axis, within some 45 degrees, |R| is averaged along it over each block of cells: the sum
over blocks is the integral. Across the rays the greatest counts.

Where a field is smooth the remainder's bound is often beaten by the rule's own, H^4 / 720 int |f''''| dt, above all
near the box's faces, where the even continuation has a kink: the lesser of the two counts in each block. Closer than
half a cell, images without end would have to be added up, and the rule's own bound is taken alone.

What a ray turns by is off by the slope of all that, which changes the path in the second order of the contrast, or by
the lever arm with which a slanted stop is met: a factor.
"""

import weakref
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle
from .quiet import block_maxima, potential_at_nodes, roughness_by_axis
from .scheme import LEAST_COSINE, LOOKUP_STRIDE, MISSED_SLOPE
from .stop import Plane

# The remainder's share at phi H = x is 1 - exp(-(x / EDGE)^24): 0.03 at 0.8, 0.14 at 0.85, 0.99 at 0.98.
EDGE, MOST_OVER_EDGE = 0.92, 2.0
# The error over int |R| dt: of the sum, and of the integral.
BOTH = 2.0
# Samples per cell of the way along an axis from which on the images of a spline are all counted by the rule's own bound,
# and up to which the nearest image is the only one in reach.
FINEST, COARSE = 0.5, 1.35
# Less than this much of phi H is no frequency along the rays; images along an axis count from this much on.
LEAST_ALONG, LEAST_IMAGED = 0.01, 0.5
# Of the midpoint rule with mended ends: its kernel, the Bernoulli polynomial of degree 4 over 4!, is at most this.
PEANO = 1.0 / 720.0
# The slope of the remainder is at most so many of its own size in a cell.
SLOPE = 3.0
# Components of a direction below which no neighbouring block is met within half a stride.
LEAST_SLANT = 0.05
# Of an axis that all rays run along, the least component; others along which they move less than a cell in a block.
LEAST_MAIN, LEVEL = 0.7, 0.25
# A lookup stands for so many blocks along that axis; strides are shorter where a way ends, and find less of them.
LOOKED_OVER, LOOKED_SHORT = 3, 1.1

# Lines that are looked at beside a body, and the outermost rays at the end of a bundle's spread (even.spread_of).
BESIDE_BODY, OUTERMOST = 192, 12

# Blocks by which a ray may be bent aside, beside its slant.
BENT = 0.5

# Tables kept for a grid.
KEPT = 8

_kept: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


@dataclass(frozen=True)
class Sampling:
    """How a bundle is sampled.

    Attributes:
        spacing: Greatest distance of a ray's samples [m].
        steepness: Greatest size of each component of the rays' unit vectors.
        lever: By how much an error of direction changes the path where the stop is met head on [m/rad].
        is_fine: Whether single precision would be seen in the bound.
    """

    spacing: float
    steepness: tuple[float, float, float]
    lever: float
    is_fine: bool = True


@dataclass(frozen=True, eq=False)
class Lines:
    """Undisturbed rays' ways through the active part of a field.

    Attributes:
        start: Where they begin [m], shape (line_count, 3).
        direction: Unit vectors, shape (line_count, 3).
        way: How far they go [m], shape (line_count,).
        lever: How far it is from there to the stop, times the tangent of the angle at which they meet it [m].
    """

    start: np.ndarray
    direction: np.ndarray
    way: np.ndarray
    lever: np.ndarray


def lines_through(field: IndexField, rays: RayBundle, until, low: np.ndarray, high: np.ndarray) -> Lines:
    """The ways of those rays that meet the part of the field from `low` to `high` [m along its own axes] at all."""
    p, d = rays.position, rays.direction
    if field.body is not None and len(p) > BESIDE_BODY:  # each costs a look at every segment of the body
        rows = np.r_[np.linspace(0, len(p) - 1, BESIDE_BODY).astype(int), np.arange(len(p) - OUTERMOST, len(p))]
        p, d = p[rows], d[rows]
    enter, leave, _ = _crossing(p, d, low, high, field.geometry)
    if field.body is not None:
        # A ray that begins inside the body is traced from where it leaves it.
        wall = field.body.crossings(p, d)
        inside = (np.count_nonzero(wall <= 0.0, axis=1) % 2).astype(bool)
        first = np.where(wall > 0.0, wall, np.inf).min(axis=1, initial=np.inf)
        enter = np.where(inside, np.maximum(enter, first), enter)
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(until, Plane):
            stop, cosine = ((until.point - p) @ until.normal) / (d @ until.normal), np.abs(d @ until.normal)
            stop = np.where(stop > 0.0, stop, np.inf)
            leave = np.minimum(leave, stop)
        else:
            grid = field.samples
            assert isinstance(grid, UniformGrid)
            _, stop, cosine = _crossing(p, d, grid.low, grid.high, field.geometry)
        tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, LEAST_COSINE)
        lever = np.where(np.isfinite(stop), tangent * (stop - enter), 0.0)
    meets = (leave > enter) & np.isfinite(leave)
    start = p[meets] + enter[meets, None] * d[meets]
    return Lines(start, d[meets], (leave - enter)[meets], lever[meets])


def _crossing(p: np.ndarray, d: np.ndarray, low: np.ndarray, high: np.ndarray, geometry: str):
    """Where rays enter and leave a box [m along them], and the cosine with the normal of the face they leave by."""
    enter, leave, cosine = np.zeros(len(p)), np.full(len(p), np.inf), np.ones(len(p))
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(geometry == "axisymmetric", len(low)):
            across = axis + 3 - len(low)
            ends = np.sort([(end - p[:, across]) / d[:, across] for end in (low[axis], high[axis])], axis=0)
            within = (p[:, across] >= low[axis]) & (p[:, across] <= high[axis])
            along = d[:, across] == 0.0
            enter = np.maximum(enter, np.where(along, np.where(within, -np.inf, np.inf), ends[0]))
            last = np.where(along, np.where(within, np.inf, -np.inf), ends[1])
            cosine = np.where(last < leave, np.abs(d[:, across]), cosine)
            leave = np.minimum(leave, last)
        if geometry == "axisymmetric":
            square = (d[:, :2] ** 2).sum(axis=1)
            middle = np.where(square > 0.0, -(p[:, :2] * d[:, :2]).sum(axis=1) / square, 0.0)
            rest = high[0] ** 2 - ((p[:, :2] + middle[:, None] * d[:, :2]) ** 2).sum(axis=1)
            half = np.where(square > 0.0, np.sqrt(np.maximum(rest, 0.0) / square), np.inf)
            enter = np.maximum(enter, middle - half)
            last = np.where(rest < 0.0, -np.inf, middle + half)
            cosine = np.where(last < leave, np.sqrt(np.maximum(rest, 0.0) * square) / high[0], cosine)
            leave = np.minimum(leave, last)
    return enter, leave, cosine


def missed_in_blocks(field: IndexField, sampling: Sampling) -> tuple[int, np.ndarray]:
    """Cells in a block, and for each block the greatest error of a ray's path per metre of it in there [1].

    Args:
        field: One on a cubic uniform grid.
        sampling: How its rays are sampled.
    """
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    store = _kept.setdefault(grid, {})
    key = (field.geometry, sampling)
    if key not in store:
        while len(store) >= KEPT:
            del store[next(iter(store))]
        store[key] = _missed(grid, field.geometry, sampling)
    return store[key]


def lookup_table(field: IndexField, sampling: Sampling) -> tuple[int, np.ndarray]:
    """The same as kernels look it up, once within a stride: each ray finds as much as lies on its way."""
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    block, missed = missed_in_blocks(field, sampling)
    slants, main = _along_axes(sampling.steepness, field.geometry), _main_axis(sampling.steepness, field.geometry)
    for axis, slant in enumerate(slants):
        if axis == main:
            missed = LOOKED_SHORT * uniform_filter1d(missed, LOOKED_OVER, axis=axis, mode="nearest")
        elif slant > LEAST_SLANT:
            # What is found a block and a half away along the main axis is beside the ray by that slope.
            wide = 3 if main is None or slant < 0.5 * slants[main] else 5
            missed = maximum_filter1d(missed, wide, axis=axis, mode="nearest")
    return block, missed


def greatest_error(field: IndexField, sampling: Sampling, lines: Lines) -> float:
    """What any of the rays misses, at most [m].

    Args:
        field: One on a cubic uniform grid.
        sampling: How its rays are sampled.
        lines: Their ways through the active part of the field.
    """
    grid = field.samples
    block, missed = missed_in_blocks(field, sampling)
    size = block * np.asarray(grid.spacing)
    local = _local_range(lines, field.geometry)
    # A block to each side for what rays are bent, and for rays between those of `lines`.
    first = np.clip(np.floor((local[0] - grid.low) / size).astype(int) - 1, 0, np.array(missed.shape) - 1)
    last = np.clip(np.floor((local[1] - grid.low) / size).astype(int) + 1, first, np.array(missed.shape) - 1)
    met = missed[tuple(slice(low, high + 1) for low, high in zip(first, last, strict=True))]
    found = float(met.max()) * float(lines.way.max(initial=0.0))
    # Along an axis that all rays run along, one layer of blocks after the other, as far beside as a ray may get.
    components = np.abs(lines.direction[:, 3 - met.ndim :])
    for axis in range(field.geometry == "axisymmetric", met.ndim):
        least = float(components[:, axis].min(initial=1.0))
        if least > 0.0:
            columns = met
            for other, slant in enumerate(_along_axes(np.abs(lines.direction).max(axis=0, initial=0.0), field.geometry)):
                if other != axis:
                    drift = slant * float(lines.way.max(initial=0.0)) / float(size[other])
                    columns = _greatest_of(columns, 1 + int(np.ceil(drift + BENT)), other)
            found = min(found, float(columns.sum(axis=axis).max()) * float(size[axis]) / least)
    return found * float(_with_lever(field, lines).max(initial=1.0))


def missed_along(field: IndexField, sampling: Sampling, lines: Lines) -> np.ndarray:
    """What straight rays miss, by the kernels' own lookup [m], shape (line_count,)."""
    block, table = lookup_table(field, sampling)
    size = block * np.asarray(field.samples.spacing)
    count = max(1, int(np.ceil(float(lines.way.max(initial=0.0)) / (LOOKUP_STRIDE * float(size.min())))))
    found = np.zeros(len(lines.way))
    for k in range(count):
        place = _local(lines.start + ((k + 0.5) / count * lines.way)[:, None] * lines.direction, field.geometry)
        entry = np.floor((place - field.samples.low) / size).astype(int)
        found += table[tuple(np.clip(entry, 0, np.array(table.shape) - 1).T)]
    return found * lines.way / count * _with_lever(field, lines)


def _with_lever(field: IndexField, lines: Lines) -> np.ndarray:
    """By how much more an error of the path counts for the error of direction that comes with it."""
    return 1.0 + MISSED_SLOPE / float(np.min(field.spacing)) * lines.lever


def _local(place: np.ndarray, geometry: str) -> np.ndarray:
    """Coordinates along the grid's own axes of places (n, 3)."""
    if geometry == "axisymmetric":
        return np.stack([np.hypot(place[:, 0], place[:, 1]), place[:, 2]], axis=1)
    return place[:, 1:] if geometry == "planar" else place


def _local_range(lines: Lines, geometry: str) -> np.ndarray:
    """Least and greatest of the lines' coordinates along the grid's own axes, shape (2, d)."""
    ends = np.concatenate([lines.start, lines.start + lines.way[:, None] * lines.direction])
    local = _local(ends, geometry)
    low, high = local.min(axis=0), local.max(axis=0)
    if geometry == "axisymmetric":
        # Between its ends a line may come nearer to the axis.
        square = np.maximum((lines.direction[:, :2] ** 2).sum(axis=1), 1e-300)
        nearest = np.clip(-(lines.start[:, :2] * lines.direction[:, :2]).sum(axis=1) / square, 0.0, lines.way)
        low[0] = np.hypot(*(lines.start[:, :2] + nearest[:, None] * lines.direction[:, :2]).T).min()
    return np.stack([low, high])


def _missed(grid: UniformGrid, geometry: str, sampling: Sampling) -> tuple[int, np.ndarray]:
    slant = _along_axes(sampling.steepness, geometry)
    block, fourth = roughness_by_axis(grid)
    strides = [PEANO * (u * sampling.spacing) ** 4 for u in slant]
    missed = _joined([stride * change for stride, change in zip(strides, fourth, strict=True)])
    if float((slant / grid.spacing).max()) * sampling.spacing >= FINEST:
        size = np.abs(_remainder(grid, slant, sampling))
        main = _main_axis(sampling.steepness, geometry)
        if main is not None and np.delete(slant, main).max(initial=0.0) > LEVEL:
            rest = _means(_maxima(size, block, [axis for axis in range(size.ndim) if axis != main]), block, main)
        elif main is not None:
            rest = _means(size, block, main)
            rest = _maxima(rest, block, [axis for axis in range(size.ndim) if axis != main])
        else:
            rest = block_maxima(size, grid, block)
        missed = np.minimum(missed, BOTH * rest.astype(np.float64))
    return block, (1.0 + MISSED_SLOPE * sampling.lever / float(grid.spacing.min())) * missed


def _remainder(grid: UniformGrid, slant: np.ndarray, sampling: Sampling) -> np.ndarray:
    """What is left at the nodes of the potential over the ambient index without its low frequencies along the rays."""
    from scipy.fft import dctn, idctn

    values = potential_at_nodes(grid).astype(np.float64 if sampling.is_fine else np.float32)
    rates = slant * sampling.spacing / grid.spacing  # of phi H, by cycles a cell
    axes = [axis for axis, count in enumerate(values.shape) if count > 1 and rates[axis] > LEAST_ALONG]
    share = np.zeros((), values.dtype)
    for images in product(*[_images(rates[axis]) for axis in axes]):
        square, along, weight = np.zeros((), values.dtype), np.zeros((), values.dtype), np.ones((), values.dtype)
        for axis, image in zip(axes, images, strict=True):
            count = values.shape[axis]
            # Frequencies of the cosines of a type I transform, in cycles a cell.
            cycles = np.abs(np.arange(count) / (2.0 * (count - 1)) + image)
            shape = [count if other == axis else 1 for other in range(values.ndim)]
            scale = sampling.spacing / grid.spacing[axis]
            square = square + ((scale * cycles) ** 2).astype(values.dtype).reshape(shape)
            along = along + (rates[axis] * cycles).astype(values.dtype).reshape(shape)
            if rates[axis] > LEAST_IMAGED:
                weight = weight * _held_share(cycles).astype(values.dtype).reshape(shape)
        over = np.minimum(np.minimum(square, along**2) / EDGE**2, MOST_OVER_EDGE)
        over = over**4
        share = share - weight * np.expm1(-over * over * over)
    return idctn(share * dctn(values, 1, axes=axes), 1, axes=axes, overwrite_x=True)


def _images(rate: float) -> tuple[int, ...]:
    """Numbers m of the images f + m / h of frequencies below 1 / (2 h) that rays may see along an axis."""
    if rate < LEAST_IMAGED:
        return (0,)
    return (0, -1) if rate > COARSE else (0, -1, 1, -2)


def _held_share(cycles: np.ndarray) -> np.ndarray:
    """B: what a cubic spline through samples holds of a cosine's `cycles` a cell, images too."""
    return 3.0 * np.sinc(cycles) ** 4 / (2.0 + np.cos(2.0 * np.pi * cycles))


def _means(values: np.ndarray, block: int, axis: int) -> np.ndarray:
    """Means over the cells of each block along an axis of values at nodes; the last block's node repeated."""
    moved = _whole_blocks(values, block, axis)
    cells = 0.5 * (moved[:-1] + moved[1:])
    return np.moveaxis(cells.reshape(-1, block, *moved.shape[1:]).mean(axis=1), 0, axis)


def _maxima(values: np.ndarray, block: int, axes) -> np.ndarray:
    """The greatest over the nodes of each block along some axes."""
    for axis in axes:
        moved = _whole_blocks(values, block, axis)
        inner = moved[:-1].reshape(-1, block, *moved.shape[1:]).max(axis=1)
        values = np.moveaxis(np.maximum(inner, moved[block::block]), 0, axis)
    return values


def _whole_blocks(values: np.ndarray, block: int, axis: int) -> np.ndarray:
    """Nodes along an axis, that axis first, the last one repeated until blocks are whole."""
    moved = np.moveaxis(values, axis, 0)
    return np.pad(moved, [(0, (1 - len(moved)) % block)] + [(0, 0)] * (moved.ndim - 1), mode="edge")


def _greatest_of(values: np.ndarray, count: int, axis: int) -> np.ndarray:
    """The greatest of `count` neighbours along an axis, of each run of them."""
    from numpy.lib.stride_tricks import sliding_window_view

    return sliding_window_view(values, min(count, values.shape[axis]), axis=axis).max(axis=-1)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Of a structure with one normal, from what each axis shows of its fourth derivative: see quiet.py."""
    return np.sum([part**0.25 for part in parts], axis=0) ** 4


def _along_axes(steepness, geometry: str) -> np.ndarray:
    """Greatest size of the components along the grid's own axes, r and z of an axisymmetric one."""
    x, y, z = steepness
    return np.array({"volume": (x, y, z), "planar": (y, z), "axisymmetric": (min(np.hypot(x, y), 1.0), z)}[geometry])


def _main_axis(steepness, geometry: str) -> int | None:
    """The grid's axis that all rays of that steepness run along, None where there is none."""
    least = np.sqrt(np.maximum(1.0 - (np.sum(np.square(steepness)) - np.square(steepness)), 0.0))
    first = {"volume": 0, "planar": 1, "axisymmetric": 2}[geometry]
    axis = first + int(np.argmax(least[first:]))
    shift = 1 if geometry != "volume" else 0
    return axis - shift if least[axis] > LEAST_MAIN else None
