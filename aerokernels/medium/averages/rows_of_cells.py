r"""Deficits of an interpolant from the cell averages it was made from, for every row of cells and for single cells.

With a_c the average over a cell of area A_c, m_c the interpolant's mean over it, and R the range of all averages,

    row k:   | sum_c A_c (a_c - m_c) | / (R sum_c A_c)          over the cells c of the row
    cells:   sqrt( sum_c A_c (a_c - m_c)^2 / sum_c A_c ) / R    over all cells, and the greatest |a_c - m_c| / R

(in an axisymmetric mesh the means are over volumes, r dr dz). Rows are those of opposite_sides.py: in a structured mesh
its rows and its columns. The deficit of a row is the mean over the lines along it.
"""

from dataclasses import dataclass

import numpy as np

from ...display.shown import shown
from ..mesh import QuadMesh
from .kept_averages import cell_deficits
from .opposite_sides import joined_across, row_numbers, widths_across
from .vertex_values import of_parents

KEPT = 1e-6  # deficit over the range of the averages below which rows count as kept


@shown
@dataclass(frozen=True)
class AveragesLacking:
    """Deficits of an interpolant from averages over cells, as fractions of their range; see the module's docstring.

    Attributes:
        rows_max: Greatest deficit or excess of a row or column of cells; None where cells are parts of triangles or
            polygons, which have no rows.
        rows_rms: Root mean square over the rows and columns, weighted by area; None as above.
        row_path: Greatest error of the optical path along a whole row [m]; None as above.
        cells_max: Greatest deficit or excess of a cell.
        cells_rms: Root mean square over the cells, weighted by area.
    """

    rows_max: float | None
    rows_rms: float | None
    row_path: float | None
    cells_max: float
    cells_rms: float

    @property
    def keeps_rows(self) -> bool:
        """Whether there are rows and columns, and all their deficits are below a millionth of the range."""
        return self.rows_max is not None and self.rows_max < KEPT

    def in_words(self) -> str:
        """Return the numbers in words, as the object of a sentence with "lacks"."""
        cells = f"of single cells {100.0 * self.cells_rms:.2g} % rms, {100.0 * self.cells_max:.2g} % at most"
        if self.rows_max is None or self.rows_rms is None or self.row_path is None:
            return f"{cells}, of the range of densities"
        if self.keeps_rows:
            return f"nothing of rows and columns of cells (below {max(self.rows_max, 1e-15):.0e} of the range); {cells}"
        return (
            f"of a row or column of cells {100.0 * self.rows_max:.2g} % of the range of densities at most "
            f"({100.0 * self.rows_rms:.2g} % rms), an optical path of {1e6 * self.row_path:.2g} µm; {cells}"
        )


def averages_lacking(mesh: QuadMesh, average: np.ndarray, values: np.ndarray) -> AveragesLacking:
    """Return the deficits of bilinear values on a mesh from the averages that they were made from.

    Args:
        mesh: The mesh; where its cells were cut in four, the rows are those of the cells before the cut.
        average: Average [1] over the flow's cell that each cell is or is a part of, shape (cell_count,).
        values: Values at the vertices, shape (vertex_count,).
    """
    lacks = of_parents(mesh, cell_deficits(mesh, average, values))
    area = mesh.cell_area if mesh.parents is None else np.bincount(mesh.parents, mesh.cell_area)
    span = float(np.ptp(average))
    scale = span or 1.0  # equal averages have no range, and no deficit
    whole = area > 0.0  # `parents` may leave out numbers
    lacks, area = np.where(whole, lacks, 0.0), np.where(whole, area, 0.0)
    cells_max = float(np.abs(lacks).max()) / scale
    cells_rms = float(np.sqrt(np.sum(area * lacks**2) / area.sum())) / scale
    flow_mesh = mesh if mesh.parents is None else mesh.whole
    if flow_mesh is None or flow_mesh.parents is not None:
        return AveragesLacking(None, None, None, cells_max, cells_rms)
    count = len(flow_mesh.cells)
    row, cell = row_numbers(joined_across(flow_mesh), count), np.tile(np.arange(count), 2)
    size = np.bincount(row, area[cell])
    mean = np.abs(np.bincount(row, (area * lacks)[cell])) / size
    path = mean * np.bincount(row, widths_across(flow_mesh))
    rms = float(np.sqrt(np.sum(size * mean**2) / size.sum())) / scale
    return AveragesLacking(float(mean.max()) / scale, rms, float(path.max()), cells_max, cells_rms)
