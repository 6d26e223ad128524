"""A mesh is drawn into its grid once: further densities on it give what a reading of their own would."""

import numpy as np
import pytest
from test_volumes import cube, linear, split

from aerokernels import flow
from aerokernels.flow.reading.dataset import HEXAHEDRON, TETRAHEDRON, Block, Cells, Dataset
from aerokernels.flow.reading.density import Reference
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.read import SharedMesh, field_of, reading_of


def reading(blocks, frame=None):
    return reading_of("test", Dataset(blocks, "test"), "rho", Frame.of(frame), 1.0, Reference(), None, None, None)


def two_blocks(seed: int, where: str, points=None):
    """Tetrahedra of one cube and hexahedra of the cube beside it, whose middle ones are missing."""
    random = np.random.default_rng(seed)
    first, corners = split(TETRAHEDRON, *cube(5)[::-1])
    second, others = cube(8)
    second = second + np.array([1.1, 0.0, 0.0])
    middle = second[others].mean(axis=1) - [1.6, 0.5, 0.5]
    others = others[np.abs(middle).max(axis=1) > 0.2]
    first = first if points is None else first + points
    made = []
    for place, cells, kind in ((first, corners, TETRAHEDRON), (second, others, HEXAHEDRON)):
        values = random.uniform(1.0, 2.0, len(cells) if where == "cell" else len(place))
        data = {"cell_data" if where == "cell" else "point_data": {"rho": values}}
        made.append(Block(place, Cells.of_one_type(kind, cells), **data))
    return made


@pytest.mark.parametrize("where", ["cell", "point"])
def test_further_densities_on_a_kept_mesh(where):
    """Set-up: two blocks, two sets of random densities. Expected: bit for bit what a map of its own gives."""
    shared = SharedMesh()
    field_of(reading(two_blocks(1, where)), 0.03, shared=shared)
    mapped, later = shared.resampling, reading(two_blocks(2, where))
    alone = field_of(later, 0.03)
    again = field_of(later, 0.03, shared=shared)
    assert shared.resampling is mapped
    assert again.density.tobytes() == alone.density.tobytes()
    assert again.provenance == alone.provenance and again.resampling == alone.resampling
    bare = mapped.apply([own for own, _ in later.densities], ambient_density=alone.ambient_density)
    assert bare.density.tobytes() == alone.density.tobytes()


@pytest.mark.parametrize("change", ["points", "frame", "spacing", "where"])
def test_another_mesh_is_drawn_anew(change):
    """Set-up: points moved by 1e-9, another frame, grid or kind of data. Expected: the shared map is not taken."""
    shared = SharedMesh()
    field_of(reading(two_blocks(1, "cell")), 0.05, shared=shared)
    first = shared.resampling
    blocks = two_blocks(2, "point" if change == "where" else "cell", 1e-9 if change == "points" else None)
    other = reading(blocks, {"optical": "-x"} if change == "frame" else None)
    spacing = 0.06 if change == "spacing" else 0.05
    found = field_of(other, spacing, shared=shared)
    assert shared.resampling is not first
    assert found.density.tobytes() == field_of(other, spacing).density.tobytes()


def test_densities_that_do_not_fit_are_refused():
    shared = SharedMesh()
    field_of(reading(two_blocks(1, "cell")[:1]), 0.05, shared=shared)
    count = len(two_blocks(1, "cell")[0].cell_data["rho"])
    with pytest.raises(ValueError, match=f"mesh {count} cells"):
        shared.resampling.apply(np.ones(count - 1))
    with pytest.raises(ValueError, match="not positive"):
        shared.resampling.apply(np.full(count, -1.0), ambient_density=1.0)
    assert shared.resampling.apply(np.full(count, 1.5)).density == pytest.approx(1.5, rel=1e-15)


def test_a_reader_keeps_the_map_from_file_to_file(tmp_path):
    """Set-up: a volume of tetrahedra in two .vtu files. Expected: one map, two fields; a series too."""
    vtk = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import VTK_TETRA, vtkUnstructuredGrid

    points, corners = split(TETRAHEDRON, *cube(3)[::-1])
    for number, factor in enumerate((1.0, 1.5)):
        grid, places = vtkUnstructuredGrid(), vtkPoints()
        places.SetDataTypeToDouble()
        places.SetData(numpy_to_vtk(points, deep=True))
        grid.SetPoints(places)
        for cell in corners:
            grid.InsertNextCell(VTK_TETRA, 4, [int(k) for k in cell])
        values = numpy_to_vtk(factor * linear(points), deep=True)
        values.SetName("rho")
        grid.GetPointData().AddArray(values)
        writer = vtk.vtkXMLUnstructuredGridWriter()
        writer.SetFileName(str(tmp_path / f"flow_{number}.vtu"))
        writer.SetInputData(grid)
        writer.Write()
    reader = flow.Reader(spacing=0.1)
    one = reader(tmp_path / "flow_0.vtu")
    shared = reader.resampling
    other = reader(tmp_path / "flow_1.vtu")
    assert reader.resampling is shared
    inside = np.random.default_rng(1).uniform(0.1, 0.9, (50, 3))
    assert one.density_at(inside) == pytest.approx(linear(inside), rel=1e-12)
    assert other.density_at(inside) == pytest.approx(1.5 * linear(inside), rel=1e-12)
    series = flow.open_series(tmp_path / "flow_*.vtu", time_step=1.0, spacing=0.1)
    assert series[1].density.tobytes() == other.density.tobytes()


@pytest.mark.parametrize("where", ["cell", "point"])
def test_each_node_has_what_the_function_of_its_cell_is_there(where):
    """Set-up: random densities of tetrahedra and hexahedra. Formula: the average plus slope times distance, clipped.

    Slopes by least squares through the corners, whose values are given or are those of `PointValues`. Error: 1e-12.
    """
    taken = reading(two_blocks(3, where))
    shared = SharedMesh()
    field = field_of(taken, 0.07, shared=shared)
    parts = shared.resampling._parts
    nodes = np.stack(np.meshgrid(*[o + h * np.arange(n) for o, h, n in
                                   zip(field.origin, field.spacing, field.density.shape, strict=True)],
                                 indexing="ij"), axis=-1).reshape(-1, 3)  # fmt: skip
    found, seen = field.density.ravel(), 0
    for part, block, (given, _) in zip(parts, taken.dataset.blocks, taken.densities, strict=True):
        width = 4 if block.cells.types[0] == TETRAHEDRON else 8
        corners = block.cells.points.reshape(-1, width)
        at_points = part.values(given)[1]
        for cell in range(0, len(corners), 17):
            place, near = block.points[corners[cell]], at_points[corners[cell]]
            middle = place.mean(axis=0)
            value = given[cell] if where == "cell" else near.mean()
            slope = np.linalg.lstsq(place - middle, near - near.mean(), rcond=None)[0]
            if width == 4:
                inside = np.linalg.solve(np.vstack([place.T, np.ones(4)]), np.vstack([nodes.T, np.ones(len(nodes))]))
                held = np.flatnonzero((inside > 1e-6).all(axis=0))
            else:  # well inside a skewed hexahedron, whose centroid is not the mean of its corners
                held = np.flatnonzero((np.abs(nodes - middle) < 1e-9).all(axis=1))
            expected = np.clip(value + (nodes[held] - middle) @ slope, min(near.min(), value), max(near.max(), value))
            assert found[held] == pytest.approx(expected, rel=1e-12)
            seen += len(held)
    assert seen > 5


@pytest.mark.parametrize("last", ["fine", "coarse"])
def test_of_blocks_that_overlap_the_finer_one_counts(last):
    """Set-up: 10^3 cells of 1 kg/m3 and, about their middle, 20^3 of 2 kg/m3, in either order. Expected: 2 there."""

    def block(low, high, n, value):
        points, corners = cube(n)
        points = low + (high - low) * np.round(n * points) / n
        return Block(points, Cells.of_one_type(HEXAHEDRON, corners), cell_data={"rho": np.full(n**3, value)})

    blocks = [block(0.0, 1.0, 10, 1.0), block(0.3, 0.7, 20, 2.0)]
    shared = SharedMesh()
    found = field_of(reading(blocks if last == "fine" else blocks[::-1]), 0.02, shared=shared)
    places = np.random.default_rng(1).uniform(0.0, 1.0, (500, 3))
    away = np.abs(places - 0.5).max(axis=1)
    at = found.density_at(places)
    assert at[away < 0.17] == pytest.approx(2.0, rel=1e-12) and at[away > 0.23] == pytest.approx(1.0, rel=1e-12)
    given = [np.full(1000, 1.0), np.full(8000, 3.0)]
    again = shared.resampling.apply(given if last == "fine" else given[::-1], ambient_density=1.0)
    assert again.density_at(places)[away < 0.17] == pytest.approx(3.0, rel=1e-12)
