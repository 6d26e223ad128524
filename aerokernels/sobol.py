"""Scrambled Sobol points in one to three dimensions.

Point i is the bitwise sum modulo 2 of direction numbers, one for each bit set in the Gray code of i; the direction
numbers are those of S. Joe, F. Y. Kuo, SIAM J. Sci. Comput. 30 (2008) 2635. The scramble is a random lower triangular
matrix over the bits, then a random shift of the bits (J. Matousek, J. Complexity 14 (1998) 527): each single point is
uniformly distributed, and 2^m points still have equal numbers in all elementary boxes of one volume.

`scipy.stats.qmc.Sobol` gives the same points to the last bit for the same seed, but importing SciPy's statistics takes
longer than all other imports of a short run.
"""

import numpy as np

BITS = 30
# Recurrence of the direction numbers of each dimension after the first: inner coefficients of its primitive polynomial,
# and the odd numbers that it starts from. The first dimension, the bit-reversed counter, has no recurrence.
_RECURRENCES: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...] = (((), (1,)), ((1,), (1, 3)))
MAX_DIMENSION = 1 + len(_RECURRENCES)


def sobol_points(count: int, dimension: int, seed: int, scramble: bool = True) -> np.ndarray:
    """Return the first `count` points of a sequence in the unit cube, shape (count, dimension).

    Args:
        count: Number of points; powers of 2 are balanced.
        dimension: 1 to MAX_DIMENSION.
        seed: Seed of the scramble.
        scramble: False gives the plain sequence, whose first point is the origin.

    Raises:
        ValueError: Fewer than one point, more than 2**BITS, or a dimension outside 1 to MAX_DIMENSION.
    """
    if not 1 <= dimension <= MAX_DIMENSION:
        raise ValueError(f"Sobol points are there in 1 to {MAX_DIMENSION} dimensions, got {dimension!r}")
    if not 1 <= count <= 2**BITS:
        raise ValueError(f"the count of Sobol points must be from 1 to 2**{BITS}, got {count!r}")
    start, directions = sobol_numbers(dimension, seed, scramble)
    point = np.empty((count, dimension), dtype=np.uint32)
    point[0] = start
    # In the reflected Gray code 2^k points are followed by the same points in reverse order with one more bit set.
    result, bit = 1, 0
    while result < count:
        more = min(result, count - result)
        point[result : result + more] = point[result - more : result][::-1] ^ directions[:, bit]
        result, bit = result + more, bit + 1
    return point * 2.0**-BITS


def sobol_numbers(dimension: int, seed: int, scramble: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return the first point of a sequence (dimension,) and its direction numbers (dimension, BITS), in BITS bits.

    Point i is the first point plus, modulo 2, the direction numbers whose bits are set in the Gray code of i.
    """
    directions = np.stack([_direction_numbers(axis) for axis in range(dimension)])
    start = np.zeros(dimension, dtype=np.uint32)
    if scramble:
        rng = np.random.default_rng(seed).spawn(1)[0]  # as in SciPy
        shift = rng.integers(2, size=(dimension, BITS), dtype=np.uint32)
        start = np.asarray(shift @ (np.uint32(1) << np.arange(BITS, dtype=np.uint32)))
        matrix = np.tril(rng.integers(2, size=(dimension, BITS, BITS), dtype=np.uint32))
        directions = _scrambled(directions, matrix)
    return start, directions


def _direction_numbers(axis: int) -> np.ndarray:
    """Return the direction numbers of a dimension, with the highest bit first; shape (BITS,)."""
    if axis == 0:
        odd = [1] * BITS
    else:
        inner, first = _RECURRENCES[axis - 1]
        odd, degree = list(first), len(first)
        for k in range(degree, BITS):
            value = odd[k - degree] ^ (odd[k - degree] << degree)
            for j, coefficient in enumerate(inner, start=1):
                value ^= coefficient * (odd[k - j] << j)
            odd.append(value)
    return np.array([m << (BITS - 1 - k) for k, m in enumerate(odd)], dtype=np.uint32)


def _scrambled(directions: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return direction numbers whose bits are multiplied by their dimension's matrix with a unit diagonal."""
    matrix = matrix.copy()
    matrix[:, range(BITS), range(BITS)] = 1
    place = np.arange(BITS - 1, -1, -1, dtype=np.uint32)
    bits = (directions[:, None, :] >> place[:, None]) & np.uint32(1)  # (dimension, bit, number)
    mixed = (matrix @ bits) & np.uint32(1)
    return np.asarray((mixed << place[:, None]).sum(axis=1, dtype=np.uint32))
