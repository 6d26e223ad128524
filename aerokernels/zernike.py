"""Zernike polynomials on the unit disc in Noll's order and normalisation (rms 1; J. Opt. Soc. Am. 66 (1976) 207).

Z_j = sqrt(n + 1) R_n^0(r) for m = 0, else sqrt(2 (n + 1)) R_n^|m|(r) times cos(m theta) for even j (m > 0) or
sin(|m| theta) for odd j (m < 0); theta is measured from x toward y. R_n^m(r) = r^m P_k^(0, m)(2 r^2 - 1) with Jacobi
polynomials P, k = (n - m) / 2: sums of factorials lose all digits at n = 40.
"""

import math

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked

__all__ = [
    "noll_to_nm",
    "zernike_modes",
    "zernike_polynomial",
]


@checked
def noll_to_nm(index: int) -> tuple[int, int]:
    """Return the order (n, m) of a Noll index, which starts at 1."""
    if not isinstance(index, (int, np.integer)) or index < 1:
        raise ValueError(f"a Noll index is a whole number of at least 1, got {index!r}")
    n = (math.isqrt(8 * (index - 1) + 1) - 1) // 2
    place = index - 1 - n * (n + 1) // 2
    size = n % 2 + 2 * ((place + (n + 1) % 2) // 2)
    return n, size if index % 2 == 0 else -size


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

    if not all(isinstance(number, (int, np.integer)) for number in (n, m)) or n < 0 or abs(m) > n or (n - m) % 2:
        raise ValueError(f"(n, m) needs n >= |m| and n - m even, got ({n!r}, {m!r})")
    z, size = np.asarray(x, dtype=np.float64) + 1j * np.asarray(y, dtype=np.float64), abs(m)
    radial = math.sqrt((n + 1) * (2 if m else 1)) * eval_jacobi((n - size) // 2, 0, size, 2.0 * np.abs(z) ** 2 - 1.0)
    turned = z**size  # r^m (cos + i sin)(m theta)
    return np.asarray(radial * (turned.imag if m < 0 else turned.real))


@checked
def zernike_modes(count: int, x: Numbers, y: Numbers) -> np.ndarray:
    """Return the first `count` Zernike polynomials in Noll's order, shape (count, ...): see `zernike_polynomial`."""
    if count < 1:
        raise ValueError(f"the count of modes is a whole number of at least 1, got {count!r}")
    return np.stack([zernike_polynomial(*noll_to_nm(index), x, y) for index in range(1, count + 1)])
