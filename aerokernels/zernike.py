r"""Zernike polynomials on the unit disc in Noll's order and normalisation (rms 1), and conversions of their indices.

    Z_j = sqrt(n + 1) R_n^0(r)                           m = 0
    Z_j = sqrt(2 (n + 1)) R_n^m(r) cos(m theta)          m > 0, which has an even j
    Z_j = sqrt(2 (n + 1)) R_n^|m|(r) sin(|m| theta)      m < 0, which has an odd j

(R. J. Noll, J. Opt. Soc. Am. 66 (1976) 207); theta is measured from x toward y. R_n^m(r) = r^m P_k^(0, m)(2 r^2 - 1)
with k = (n - m) / 2 and Jacobi polynomials P, evaluated by a recurrence: sums of factorials lose all digits at n = 40.
Orders are pairs (n, m), with negative m for sines. ANSI (OSA) indices start at 0, fringe (Arizona) and Noll indices
at 1.
"""

import math

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked

__all__ = [
    "ansi_to_nm",
    "fringe_to_nm",
    "nm_to_ansi",
    "nm_to_fringe",
    "nm_to_noll",
    "noll_to_nm",
    "zernike_modes",
    "zernike_polynomial",
]


def _index(value, least: int, name: str) -> int:
    if not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"a {name} index is a whole number of at least {least}, got {value!r}")
    return int(value)


def _order(n, m) -> tuple[int, int]:
    whole = all(isinstance(number, (int, np.integer)) for number in (n, m))
    if not whole or n < 0 or abs(m) > n or (n - m) % 2:
        raise ValueError(f"(n, m) needs n >= |m| and n - m even, got ({n!r}, {m!r})")
    return int(n), int(m)


@checked
def noll_to_nm(index: int) -> tuple[int, int]:
    """Return the order (n, m) of a Noll index, which starts at 1.

    Examples:
        >>> noll_to_nm(7)
        (3, -1)
    """
    index = _index(index, 1, "Noll")
    n = (math.isqrt(8 * (index - 1) + 1) - 1) // 2
    rest = index - 1 - n * (n + 1) // 2
    size = n % 2 + 2 * ((rest + (n + 1) % 2) // 2)
    return n, size if index % 2 == 0 else -size


@checked
def nm_to_noll(n: int, m: int) -> int:
    """Return the Noll index, which starts at 1, of an order (n, m).

    Examples:
        >>> nm_to_noll(3, -1)
        7
    """
    n, m = _order(n, m)
    first = (m > 0 and n % 4 in (0, 1)) or (m < 0 and n % 4 in (2, 3))
    return n * (n + 1) // 2 + abs(m) + (0 if first else 1)


@checked
def ansi_to_nm(index: int) -> tuple[int, int]:
    """Return the order (n, m) of an ANSI (OSA) index, which starts at 0."""
    index = _index(index, 0, "ANSI")
    n = (math.isqrt(8 * index + 1) - 1) // 2
    return n, 2 * index - n * (n + 2)


@checked
def nm_to_ansi(n: int, m: int) -> int:
    """Return the ANSI (OSA) index, which starts at 0, of an order (n, m)."""
    n, m = _order(n, m)
    return (n * (n + 2) + m) // 2


@checked
def fringe_to_nm(index: int) -> tuple[int, int]:
    """Return the order (n, m) of a fringe (University of Arizona) index, which starts at 1."""
    index = _index(index, 1, "fringe")
    side = math.isqrt(index - 1) + 1
    rest = side * side - index
    m = (rest + 1) // 2
    return 2 * (side - 1) - m, -m if rest % 2 else m


@checked
def nm_to_fringe(n: int, m: int) -> int:
    """Return the fringe (University of Arizona) index, which starts at 1, of an order (n, m)."""
    n, m = _order(n, m)
    return (1 + (n + abs(m)) // 2) ** 2 - 2 * abs(m) + (1 if m < 0 else 0)


@checked
def zernike_polynomial(n: int, m: int, x: Numbers, y: Numbers) -> np.ndarray:
    """Return the Zernike polynomial of an order (n, m), which has rms 1 over the unit disc.

    Args:
        n: Radial order.
        m: Azimuthal order; negative for sines.
        x: Coordinates along x over the radius of the disc, any shape.
        y: Coordinates along y over the radius of the disc, of the same shape.

    Raises:
        ValueError: An order that does not exist.
    """
    from scipy.special import eval_jacobi

    n, m = _order(n, m)
    z, size = np.asarray(x, dtype=np.float64) + 1j * np.asarray(y, dtype=np.float64), abs(m)
    radial = math.sqrt((n + 1) * (2 if m else 1)) * eval_jacobi((n - size) // 2, 0, size, 2.0 * np.abs(z) ** 2 - 1.0)
    turned = z**size  # r^m (cos + i sin)(m theta)
    return np.asarray(radial * (turned.imag if m < 0 else turned.real))


@checked
def zernike_modes(count: int, x: Numbers, y: Numbers) -> np.ndarray:
    """Return the first `count` Zernike polynomials in Noll's order, shape (count, ...): see `zernike_polynomial`."""
    count = _index(count, 1, "Noll")
    return np.stack([zernike_polynomial(*noll_to_nm(index), x, y) for index in range(1, count + 1)])
