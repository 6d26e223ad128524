"""Fields that are thin phase plates: an optical path difference of one's choice over x and y, and nothing else."""

import numpy as np

from aerokernels import IndexField, zernike

WAVELENGTH = 905e-9
DEPTH = 2e-3
RADIUS = 2e-3  # of the disc on which `modes` are orthogonal


def phase_plate(opd, half_width: float, count: int = 43, **options) -> IndexField:
    """A volume between z = 0 and DEPTH whose rays along z gather opd(x, y) [m]; air at rest on both sides of it.

    The contrast is opd / length times sin^4 of z, whose mean over the depth is 3/8, by the trapezoidal rule too.
    """
    x, z = np.linspace(-half_width, half_width, count), DEPTH / 16 * np.arange(-3, 20)
    along = np.where((z > 0.0) & (z < DEPTH), np.sin(np.pi * z / DEPTH) ** 4, 0.0)
    path = opd(x[:, None], x[None, :])
    contrast = path[:, :, None] * along / (0.375 * DEPTH)
    spacing = (x[1] - x[0], x[1] - x[0], DEPTH / 16)
    return IndexField.from_samples(
        contrast, origin=(-half_width, -half_width, z[0]), spacing=spacing, geometry="volume", **options
    )


def modes(coefficients: dict[int, float]):
    """OPD that is a sum of Zernike polynomials over RADIUS [m], by Noll's index."""

    def opd(x, y):
        orders = {index: zernike.noll_to_nm(index) for index in coefficients}
        return sum(c * zernike.zernike_polynomial(*orders[j], x / RADIUS, y / RADIUS) for j, c in coefficients.items())

    return opd
