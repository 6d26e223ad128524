r"""What an interpolant lacks of the averages that it was made from: of every row of cells, and of single cells.

With a_c the average over a cell of area A_c, m_c the interpolant's mean over it, and R the range of all averages,

    row k:   | sum_c A_c (a_c - m_c) | / (R sum_c A_c)          over the cells c of the row
    cells:   sqrt( sum_c A_c (a_c - m_c)^2 / sum_c A_c ) / R    over all cells, and the greatest |a_c - m_c| / R

(in an axisymmetric mesh the means are those over volumes, r dr dz). Rows are those of opposite_sides.py: in
a structured mesh its rows and its columns. Lines side by side that fill a row hold together what the row lacks.
"""

from dataclasses import dataclass

import numpy as np

from ..display.shown import shown
from .kept_averages import what_is_lacking
from .mesh import QuadMesh
from .opposite_sides import joined_across, row_numbers, ways_across
from .vertex_values import of_parents

KEPT = 1e-6  # of the range of the averages: rows that lack less are said to be kept


@shown
@dataclass(frozen=True)
class AveragesLacking:
    """What an interpolant lacks of averages over cells, in shares of the range of these; see the head of this file.

    Attributes:
        rows_max: The row, or column, of cells that lacks or exceeds most; None where cells were cut of triangles or
            polygons, which lie in no rows.
        rows_rms: Root mean square over the rows and columns, by their areas; None as above.
        row_path: The greatest optical path that a row as long as it is lacks or exceeds [m]; None as above.
        cells_max: The cell that lacks or exceeds most.
        cells_rms: Root mean square over the cells, by their areas.
    """

    rows_max: float | None
    rows_rms: float | None
    row_path: float | None
    cells_max: float
    cells_rms: float

    @property
    def keeps_rows(self) -> bool:
        """Whether there are rows and columns, and all of them hold what the averages hold, within a millionth."""
        return self.rows_max is not None and self.rows_max < KEPT

    def in_words(self) -> str:
        """The numbers in words that go on after "lacks"."""
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
    """What bilinear values on a mesh lack of the averages that they were made from.

    Args:
        mesh: The mesh; where its cells were cut in four, the rows are those of the cells before.
        average: Average [1] over the flow's cell that each cell is or is a part of, shape (cell_count,).
        values: Values at the vertices, shape (vertex_count,).
    """
    lacks = of_parents(mesh, what_is_lacking(mesh, average, values))
    area = mesh.cell_area if mesh.parents is None else np.bincount(mesh.parents, mesh.cell_area)
    span = float(np.ptp(average))
    scale = span or 1.0  # averages that are all the same lack nothing of any range
    whole = area > 0.0  # numbers that no part has
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
    path = mean * np.bincount(row, ways_across(flow_mesh))
    rms = float(np.sqrt(np.sum(size * mean**2) / size.sum())) / scale
    return AveragesLacking(float(mean.max()) / scale, rms, float(path.max()), cells_max, cells_rms)
