"""Time how volumes of cell averages are put onto a grid: the first snapshot, and each further one.

A cube of hexahedra, or of twelve tetrahedra in each of them (75 a side: 5,062,500), is written as a .vtu file, read by
`flow.Reader`, and further densities are given to `reader.resampling.apply`. Wall and processor time [s] of each step,
and the peak memory of this process. Each step is repeated; an idle machine gives the least times.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from aerokernels import flow
from aerokernels.flow.reading.dataset import HEXAHEDRON, TETRAHEDRON

HEXAHEDRA = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
QUADRILATERALS = [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]


def mesh(kind: str, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points [m] of the unit cube and the corners of its cells."""
    axis = np.linspace(0.0, 1.0, side + 1)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    index = np.arange((side + 1) ** 3).reshape([side + 1] * 3)
    cells = np.stack([index[a : side + a, b : side + b, c : side + c].ravel() for a, b, c in HEXAHEDRA], axis=1)
    if kind == "hexahedra":
        return points, cells
    middle = len(points) + np.arange(len(cells))
    points = np.concatenate([points, points[cells].mean(axis=1)])
    faces = np.concatenate([np.column_stack([cells[:, face], middle]) for face in QUADRILATERALS])
    turn = np.argmin(faces[:, :4], axis=1)  # both cells of a face share one diagonal, from the lowest corner
    faces[:, :4] = faces[np.arange(len(faces))[:, None], (turn[:, None] + np.arange(4)) % 4]
    return points, np.concatenate([faces[:, [0, 1, 2, 4]], faces[:, [0, 2, 3, 4]]])


def write(path: Path, kind: str, points: np.ndarray, cells: np.ndarray, density: np.ndarray) -> None:
    """Write a .vtu file by VTK, uncompressed."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    grid, places, array = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
    places.SetDataTypeToDouble()
    places.SetData(numpy_to_vtk(points))
    grid.SetPoints(places)
    start = cells.shape[1] * np.arange(len(cells) + 1)
    flat = np.ascontiguousarray(cells).ravel()
    array.SetData(numpy_to_vtkIdTypeArray(start), numpy_to_vtkIdTypeArray(flat))
    grid.SetCells(HEXAHEDRON if kind == "hexahedra" else TETRAHEDRON, array)
    values = numpy_to_vtk(density)
    values.SetName("rho")
    grid.GetCellData().AddArray(values)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.SetCompressorTypeToNone()
    writer.Write()


def main() -> None:
    """Print a line per step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=("tetrahedra", "hexahedra"), default="tetrahedra")
    parser.add_argument("--side", type=int, default=75, help="hexahedra along an edge of the cube")
    parser.add_argument("--nodes", type=int, default=300, help="of the grid along an edge of the cube")
    parser.add_argument("--repeats", type=int, default=5, help="of further snapshots")
    asked = parser.parse_args()

    def timed(what: str, work):
        wall, processor = time.perf_counter(), time.process_time()
        found = work()
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(f"{what:28s} {wall:8.3f} s   {processor:8.3f} CPU s   {memory:5.2f} GB at most", flush=True)
        return found

    with tempfile.TemporaryDirectory() as folder:
        points, cells = mesh(asked.kind, asked.side)
        density = 1.2 + 0.3 * np.sin(4.0 * points[cells, 0].mean(axis=1))
        path = Path(folder) / "flow.vtu"
        write(path, asked.kind, points, cells, density)
        print(f"{len(cells):,} {asked.kind}, {asked.nodes}^3 nodes")
        del points, cells
        reader = flow.Reader(spacing=1.0 / (asked.nodes - 1))
        timed("first snapshot, from a file", lambda: reader(path))
        timed("further one, from a file", lambda: reader(path))
        for _ in range(asked.repeats):
            field = timed("further densities", lambda: reader.resampling.apply(1.1 * density))
            timed("their index field", lambda field=field: field.index_field(905e-9, "ciddor"))


if __name__ == "__main__":
    main()
