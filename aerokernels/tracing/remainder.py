r"""The part of a field's potential that evenly spaced samples along a ray do not resolve, at the nodes of its grid.

A component of frequency f [1/m] has along a unit vector u at most the frequency

    phi = min(|f|, sum |u_i| f_i),     in r and z: f_r sqrt(u_x^2 + u_y^2) + f_z |u_z|

(cos(2 pi f sqrt(b^2 + t^2)) is an entire function of t of that type, so that this holds off the axis too), and by
samples H apart it belongs to the remainder from about phi = edge / H on. The field is even about its faces, as an
axisymmetric one is about its axis.

Through nodes h apart a cubic spline holds, of what oscillates between them at v cycles a cell, v below 1 / 2, the share
B(v) at that frequency and the share B(v + m) at each image v + m,

    B(v) = 3 (sin(pi v) / (pi v))^4 / (2 + cos(2 pi v)),

and that is what rays meet: it falls off fast beyond what the nodes resolve, where H is below two cells.
"""

from itertools import product

import numpy as np

from ..medium.grid import UniformGrid
from .quiet import potential_at_nodes

# A component's share in the remainder at phi H = x is 1 - exp(-(x / edge)^24): of edge 0.92 0.03 at 0.8, 0.99 at 0.98.
MOST_OVER_EDGE = 2.0
# Cells between samples from which on the nearest image is the only one that they do not resolve.
COARSE = 1.35
# Less than this much of phi H is no frequency along the rays; images along an axis count from this much a cycle on.
LEAST_ALONG, LEAST_IMAGED = 0.01, 0.5


def remainders(
    grid: UniformGrid, steepness: np.ndarray, spacing: float, edges: tuple[float, ...], is_fine: bool
) -> list[np.ndarray]:
    """For each edge, what is left of the potential over the ambient index without low frequencies along the rays [1].

    Args:
        grid: The samples.
        steepness: Greatest size of the components of the rays' unit vectors along the grid's axes.
        spacing: H, distance of samples [m].
        edges: Frequencies times H from about which on components are left.
        is_fine: Whether single precision would be seen.
    """
    from scipy.fft import dctn, idctn

    values = potential_at_nodes(grid).astype(np.float64 if is_fine else np.float32)
    rates = steepness * spacing / grid.spacing  # phi H by cycles a cell
    axes = [axis for axis, count in enumerate(values.shape) if count > 1 and rates[axis] > LEAST_ALONG]
    if not axes:
        return [np.zeros_like(values) for _ in edges]
    shares: list = [np.zeros((), values.dtype)] * len(edges)
    for images in product(*[_images(rates[axis]) for axis in axes]):
        square, along, weight = np.zeros((), values.dtype), np.zeros((), values.dtype), np.ones((), values.dtype)
        for axis, image in zip(axes, images, strict=True):
            count = values.shape[axis]
            # Frequencies of the cosines of a type I transform, in cycles a cell.
            cycles = np.abs(np.arange(count) / (2.0 * (count - 1)) + image)
            shape = [count if other == axis else 1 for other in range(values.ndim)]
            square = square + ((spacing / grid.spacing[axis] * cycles) ** 2).astype(values.dtype).reshape(shape)
            along = along + (rates[axis] * cycles).astype(values.dtype).reshape(shape)
            if len(_images(rates[axis])) > 1:
                weight = weight * _held_share(cycles).astype(values.dtype).reshape(shape)
        square = np.minimum(square, along**2)
        for number, edge in enumerate(edges):
            over = np.minimum(square * values.dtype.type(edge**-2), values.dtype.type(MOST_OVER_EDGE)) ** 4
            shares[number] = shares[number] - weight * np.expm1(-(over * over * over))
    found = dctn(values, 1, axes=axes)
    return [idctn(share * found, 1, axes=axes, overwrite_x=True) for share in shares]


def _images(rate: float) -> tuple[int, ...]:
    """Numbers m of the images that count along an axis, of phi H a cycle."""
    if rate < LEAST_IMAGED:
        return (0,)
    return (0, -1) if rate > COARSE else (0, -1, 1, -2)


def _held_share(cycles: np.ndarray) -> np.ndarray:
    """B: what a cubic spline through nodes holds of a cosine of so many cycles a cell, an image of slower ones too."""
    return 3.0 * np.sinc(cycles) ** 4 / (2.0 + np.cos(2.0 * np.pi * cycles))
