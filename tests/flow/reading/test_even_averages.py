"""Averages over even cells: values at the corners whose cubic spline keeps the averages, and every row's sum."""

import numpy as np
import pytest

from aerokernels import DensityField
from aerokernels.medium import spline


def field_of_averages(cells: np.ndarray):
    """A density field from averages over cells [x, y, z] of the unit cube, as pyvista would hand them over."""
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    data = vtkImageData()
    data.SetDimensions(*(n + 1 for n in cells.shape))
    data.SetSpacing(*(1.0 / n for n in cells.shape))
    values = numpy_to_vtk(cells.ravel(order="F"), deep=True)
    values.SetName("rho")
    data.GetCellData().AddArray(values)
    return DensityField.from_pyvista(data)


def mean(primitive, n: int) -> np.ndarray:
    """Averages over n even cells of [0, 1] of what has this primitive."""
    return np.diff(primitive(np.linspace(0.0, 1.0, n + 1))) * n


def smooth_averages(n: int) -> np.ndarray:
    parts = [mean(lambda s: -np.cos(3.0 * s + 1.0) / 3.0, n), *2 * [mean(lambda s: np.sin(2.0 * s) / 2.0, n)]]
    return 2.0 + np.einsum("i,j,k->ijk", *parts)


def means_of_spline(nodes: np.ndarray) -> np.ndarray:
    """Averages over the cells of the tensor-product spline, by three Gauss points along each axis."""
    place, share = np.polynomial.legendre.leggauss(3)
    for axis in range(3):
        coefficient = np.moveaxis(spline.spline_along(nodes, axis, False), axis, 0)
        own = spline.weights("cubic", 0.5 + 0.5 * place)[0] @ (0.5 * share)
        count = len(coefficient) - 3
        nodes = np.moveaxis(sum(own[k] * coefficient[k : k + count] for k in range(4)), 0, axis)
    return nodes


def test_the_spline_keeps_the_averages():
    """Set-up: the same averages, n = 32. Formula: the spline's mean over each cell.

    Expected: the cell's average within 1e-7 of the range four cells from the edge, and within 1e-5 at the edge.
    """
    cells = smooth_averages(32)
    lacks = np.abs(means_of_spline(field_of_averages(cells).density) - cells) / np.ptp(cells)
    assert lacks[6:-6, 6:-6, 6:-6].max() < 1e-7 and lacks.max() < 1e-5


def test_what_averages_lack_at_a_shock_is_told():
    """Set-up: averages of 1 + 0.2 sin(4 x), and of 1 more behind x + 0.4 z = 0.73, over 16^3 cells; a linear density.

    Formula: columns along z at 200 places, against three times the reported error, as budgets take it. Expected: all
    are covered, by less than a hundredfold of their rms; of a linear density nothing is reported but rounding.
    """
    n, fine = 16, 12
    x, z = np.meshgrid(*2 * [(np.arange(n * fine) + 0.5) / (n * fine)], indexing="ij")

    def density(x, z):
        return 1.0 + 0.2 * np.sin(4.0 * x) + (x + 0.4 * z > 0.73)

    cells = density(x, z).reshape(n, fine, n, fine).mean(axis=(1, 3))
    found = field_of_averages(np.repeat(cells[:, None], n, axis=1))
    lines = np.random.default_rng(8).uniform(0.0, 1.0, (200, 2))
    along = (np.arange(400) + 0.5) / 400
    places = np.column_stack([np.repeat(lines, 400, axis=0), np.tile(along, 200)])
    wrong = found.density_at(places).reshape(200, 400).mean(axis=1) - density(lines[:, :1], along).mean(axis=1)
    told = 3.0 * found.resampling.column_error
    assert np.abs(wrong).max() < told < 100.0 * np.sqrt(np.mean(wrong**2))
    x, y, z = np.meshgrid(*3 * [(np.arange(n) + 0.5) / n], indexing="ij")
    assert field_of_averages(1.0 + x + 2.0 * y + 0.5 * z).resampling.column_error < 1e-12
