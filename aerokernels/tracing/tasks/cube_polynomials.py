"""Cubic polynomials of cubes of cells: a volume's potential from 20 adjacent numbers in place of 64.

One polynomial for CUBE_SIDE^3 cells is one piece of 64 bytes, a cache line; to fit, coefficients of the third degree
are upper halves of floats. It is the spline's projection, so that its deviation mostly cancels along a ray; a ray sums
the bound stored with it, as if nothing cancelled, as part of its own error estimate.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre

from aerokernels.derived import cached_on
from aerokernels.medium.grid import GridPlaces, UniformGrid
from aerokernels.medium.spline import SUPPORT, weights
from aerokernels.process.threads import in_threads, product_on_one_core
from aerokernels.tracing.lines import Lines
from aerokernels.tracing.scheme import CUBE_ROW, CUBE_SIDE

DEGREE = 3
# Powers of the three coordinates of each coefficient, in the kernels' order: the third degree last, each group ordered
# by powers of the third coordinate, then of the second.
POWERS = sorted(
    ((i, j, k) for k in range(DEGREE + 1) for j in range(DEGREE + 1 - k) for i in range(DEGREE + 1 - k - j)),
    key=lambda powers: sum(powers) == DEGREE,
)
WHOLE = sum(sum(powers) < DEGREE for powers in POWERS)
# Windows of coefficients that are processed together.
SLAB = 1 << 14  # speed only
# Places along a line at which is estimated whether a table is worth making.
PLACES = 24
# The share of the greatest deviation of a slope that counts for each sample in a cube. The greatest deviation occurs at
# corners; the rms is about a fifth of it.
OFTEN = 0.5


def may_have_cubes(grid: UniformGrid, memory: float) -> bool:
    """Whether a uniform grid is a cubic volume whose table fits this many bytes and a 32-bit index."""
    if len(grid.shape) != 3 or grid.interpolation != "cubic":
        return False
    numbers = CUBE_ROW * int(np.prod([-(-(count - 1) // CUBE_SIDE) for count in grid.shape]))
    return numbers < 2**31 and 4 * numbers <= memory


def cube_polynomials(grid: UniformGrid) -> np.ndarray:
    """The polynomials of a grid that `may_have_cubes`, float32, shape (cubes along each axis, CUBE_ROW).

    Coefficients are those of POWERS, of coordinates from -1 to 1; from WHOLE on two share a float, the first in the
    lower bits. The last float holds the greatest deviation of the potential, and OFTEN times that of its slopes [1/m].
    """
    cells = [count - 1 for count in grid.shape]
    shape = tuple(-(-count // CUBE_SIDE) for count in cells)
    width = CUBE_SIDE + SUPPORT["cubic"] - 1
    # Windows reach beyond the last cell; their coefficients there have no weight.
    missing = [(0, CUBE_SIDE * cubes - count) for cubes, count in zip(shape, cells, strict=True)]
    padded = np.pad(grid.coefficients.astype(np.float32), missing)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (width,) * 3)[::CUBE_SIDE, ::CUBE_SIDE, ::CUBE_SIDE]
    table = np.empty((*shape, CUBE_ROW), np.float32)
    steepest = DEGREE * 2.0 / (CUBE_SIDE * float(grid.spacing.min()))  # slope of a power over its size
    for parts in product(*(_parts(count) for count in cells)):
        place = tuple(part for part, _ in parts)
        operators, points = _operators(grid.places, tuple(inside for _, inside in parts))

        def fill(first: slice, place=place, operators=operators, points=points) -> None:
            some = first, *place[1:]
            made = product_on_one_core(windows[some].reshape(-1, width**3), operators).T
            numbers, deviation = made[: len(POWERS)], np.abs(made[len(POWERS) :])
            value, cut = _value_bound(numbers, deviation[:points])
            slope = OFTEN * (deviation[points:].max(axis=0) + cut * steepest)
            table[some] = _packed(numbers, value, slope).reshape(table[some].shape)

        layers = max(1, (place[0].stop - place[0].start) * SLAB * CUBE_ROW // max(table[place].size, 1))  # speed only
        starts = range(place[0].start, place[0].stop, layers)
        in_threads(fill, [slice(first, min(first + layers, place[0].stop)) for first in starts])
    return table


def _value_bound(numbers: np.ndarray, deviation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bound the deviation of polynomials from the spline, given deviations at some points; and its part by rounding."""
    # Relative rounding of a coefficient of the third degree, at most: the upper half of a float has eight binary
    # digits.
    cut = (2.0**-8) * np.abs(numbers[WHOLE:]).sum(axis=0)
    # The greatest deviation of the potential anywhere over the greatest at the tested points: nodes and the middles of
    # cells.
    return 1.5 * deviation.max(axis=0) + cut, cut


def approximate_deviation(grid: UniformGrid, lines: Lines) -> np.ndarray:
    """Approximate sum of polynomials' deviations from the spline along some lines [m of OPD], by PLACES cubes."""
    whole = np.array([(count - 1) // CUBE_SIDE for count in grid.shape])
    share = (np.arange(PLACES) + 0.5) / PLACES
    place = lines.start[:, None] + (share * lines.length[:, None])[..., None] * lines.direction[:, None]
    cube = np.clip((place.reshape(-1, 3) - grid.origin) / (CUBE_SIDE * grid.spacing), 0, whole - 1).astype(int)
    width = CUBE_SIDE + SUPPORT["cubic"] - 1
    node = [CUBE_SIDE * cube[:, axis, None] + np.arange(width) for axis in range(3)]
    windows = grid.coefficients[node[0][:, :, None, None], node[1][:, None, :, None], node[2][:, None, None, :]]
    operators, points = _operators(grid.places, (CUBE_SIDE,) * 3)
    # Without lines the arrays are empty: the rays meet no disturbed air.
    tested = np.ascontiguousarray(operators[:, : len(POWERS) + points])
    made = product_on_one_core(windows.reshape(len(cube), width**3).astype(np.float32), tested).T
    value, _ = _value_bound(made[: len(POWERS)], np.abs(made[len(POWERS) :]))
    return value.reshape(-1, PLACES).mean(axis=1) * lines.length


def _packed(numbers: np.ndarray, value: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Pack coefficients in the order of POWERS, shape (20, n), and bounds (n,) into rows of a table, (n, CUBE_ROW)."""
    bits = np.concatenate([numbers[WHOLE:], [value, slope]]).astype(np.float32).view(np.uint32)
    up = np.full((len(bits), 1), 0x8000, np.uint32)  # round to nearest; bounds are rounded up
    up[-2:] = 0xFFFF
    halves = bits + up >> np.uint32(16)
    return np.concatenate([numbers[:WHOLE], (halves[0::2] | halves[1::2] << np.uint32(16)).view(np.float32)]).T


def _parts(cells: int) -> list[tuple[slice, int]]:
    """Cubes along an axis, and how many of their cells are in the grid: whole cubes, then the last if it is partial."""
    whole, rest = divmod(cells, CUBE_SIDE)
    parts = [(slice(0, whole), CUBE_SIDE), (slice(whole, whole + 1), rest)]
    return [part for part in parts if part[0].stop > part[0].start and part[1]]


@cached_on("places", 8)
def _operators(places: GridPlaces, inside: tuple[int, ...]) -> tuple[np.ndarray, int]:
    """The operator from a window of coefficients to a cube's polynomial and its deviations from the spline."""
    alike = {count: _axis(count) for count in set(inside)}
    axes = [alike[count] for count in inside]
    moments = [[axis.moments[n] for axis, n in zip(axes, row, strict=True)] for row in POWERS]
    projected = np.stack([np.einsum("a,b,c->abc", *factors).ravel() for factors in moments], 1)
    in_powers = np.array(
        [[np.prod([axes[d].in_powers[row[d], to[d]] for d in range(3)]) for to in POWERS] for row in POWERS]
    )
    fit = projected @ in_powers
    off = []
    for slope in (None, 0, 1, 2):
        for marks in range(2):
            spline = [axis.spline[marks][int(d == slope)] for d, axis in enumerate(axes)]
            cubic = [axis.cubic[marks][int(d == slope)] for d, axis in enumerate(axes)]
            there = np.einsum("ax,by,cz->abcxyz", *spline).reshape(len(fit), -1)
            made = np.stack([np.einsum("x,y,z->xyz", *(cubic[d][row[d]] for d in range(3))).ravel() for row in POWERS])
            off.append((there - fit @ made) / (1.0 if slope is None else places.spacing[slope]))
    points = off[0].shape[1] + off[1].shape[1]
    return np.concatenate([fit, *off], axis=1).astype(np.float32), points


@dataclass(frozen=True, eq=False)
class _Axis:
    """Factors along one axis of a cube, of which some cells are in the grid.

    `moments` (4, coefficients): weights of the window's coefficients in each Legendre polynomial; `in_powers` (4, 4):
    these in powers. At nodes, and in the middles of cells: weights in value and slope per cell of coefficients, and of
    powers.
    """

    moments: np.ndarray
    in_powers: np.ndarray
    spline: list[tuple[np.ndarray, np.ndarray]]
    cubic: list[tuple[np.ndarray, np.ndarray]]


def _axis(inside: int) -> _Axis:
    # Points of a Gauss rule in each cell, for which the projection is exact.
    gauss, share = legendre.leggauss(4)
    place = (np.arange(inside)[:, None] + 0.5 * (gauss + 1.0)).ravel()
    basis = [Legendre.basis(n, domain=[0.0, inside]) for n in range(DEGREE + 1)]
    at = _window_weights(place, inside)[0] * np.tile(share, inside) / (2.0 * inside)
    moments = np.stack([(2 * n + 1) * (at @ one(place)) for n, one in enumerate(basis)])
    cube = [0.0, float(CUBE_SIDE)]
    powers = [one.convert(kind=Polynomial, domain=cube, window=[-1.0, 1.0]).coef for one in basis]
    in_powers = np.stack([np.pad(row, (0, DEGREE + 1 - len(row))) for row in powers])
    spline, cubic = [], []
    for marks in (np.arange(inside + 1.0), np.arange(inside) + 0.5):
        spline.append(_window_weights(marks, inside))
        of = [Polynomial.basis(n, domain=cube, window=[-1.0, 1.0]) for n in range(DEGREE + 1)]
        cubic.append((np.stack([one(marks) for one in of]), np.stack([one.deriv()(marks) for one in of])))
    return _Axis(moments, in_powers, spline, cubic)


def _window_weights(place: np.ndarray, inside: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of a window's coefficients at places in cells from its first node, in the values and in the slopes."""
    cell = np.minimum(place.astype(int), inside - 1)
    made = np.zeros((2, CUBE_SIDE + SUPPORT["cubic"] - 1, len(place)))
    for kind, rows in enumerate(weights("cubic", place - cell)):
        for k, row in enumerate(rows):
            made[kind, cell + k, np.arange(len(place))] = row
    return made[0], made[1]
