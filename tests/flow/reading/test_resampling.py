"""A mesh is drawn into its grid once: further densities on it give what a reading of their own would."""

import numpy as np
import pytest
import vtk_writers
from test_volumes import cube, linear, split

from aerokernels import flow
from aerokernels.flow.reading.dataset import HEXAHEDRON, TETRAHEDRON, Block, Cells, Dataset
from aerokernels.flow.reading.read import checked_options, field_of, reading_of


def reading(blocks, spacing=0.05, frame=None):
    options = checked_options({"density": "rho", "frame": frame, "spacing": spacing}, "test")
    return reading_of("test", Dataset(blocks, "test"), options)


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
    shared = flow.Reader()
    field_of(reading(two_blocks(1, where), 0.03), shared)
    mapped, later = shared.resampling, reading(two_blocks(2, where), 0.03)
    alone = field_of(later)
    again = field_of(later, shared)
    assert shared.resampling is mapped
    assert again.density.tobytes() == alone.density.tobytes()
    assert again.provenance == alone.provenance and again.resampling == alone.resampling
    bare = mapped.apply([own for own, _ in later.densities], ambient_density=alone.ambient_density)
    assert bare.density.tobytes() == alone.density.tobytes()


@pytest.mark.parametrize("change", ["points", "frame", "spacing", "where"])
def test_another_mesh_is_drawn_anew(change):
    """Set-up: points moved by 1e-9, another frame, grid or kind of data. Expected: the shared map is not taken."""
    shared = flow.Reader()
    field_of(reading(two_blocks(1, "cell")), shared)
    first = shared.resampling
    blocks = two_blocks(2, "point" if change == "where" else "cell", 1e-9 if change == "points" else None)
    frame = {"optical": "-x"} if change == "frame" else None
    other = reading(blocks, 0.06 if change == "spacing" else 0.05, frame)
    found = field_of(other, shared)
    assert shared.resampling is not first
    assert found.density.tobytes() == field_of(other).density.tobytes()


def test_a_reader_keeps_the_map_from_file_to_file(tmp_path):
    """Set-up: a volume of tetrahedra in two .vtu files. Expected: one map, two fields; a series too."""
    pytest.importorskip("vtkmodules")
    points, corners = split(TETRAHEDRON, *cube(3)[::-1])
    for number, factor in enumerate((1.0, 1.5)):
        grid = vtk_writers.vtk_cells(points, [(10, cell) for cell in corners], rho=factor * linear(points))
        vtk_writers.write_vtk(tmp_path / f"flow_{number}.vtu", grid)
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


@pytest.mark.parametrize("last", ["fine", "coarse"])
def test_of_blocks_that_overlap_the_finer_one_counts(last):
    """Set-up: 10^3 cells of 1 kg/m3 and, about their middle, 20^3 of 2 kg/m3, in either order. Expected: 2 there."""

    def block(low, high, n, value):
        points, corners = cube(n)
        points = low + (high - low) * np.round(n * points) / n
        return Block(points, Cells.of_one_type(HEXAHEDRON, corners), cell_data={"rho": np.full(n**3, value)})

    blocks = [block(0.0, 1.0, 10, 1.0), block(0.3, 0.7, 20, 2.0)]
    shared = flow.Reader()
    found = field_of(reading(blocks if last == "fine" else blocks[::-1], 0.02), shared)
    places = np.random.default_rng(1).uniform(0.0, 1.0, (500, 3))
    away = np.abs(places - 0.5).max(axis=1)
    at = found.density_at(places)
    assert at[away < 0.17] == pytest.approx(2.0, rel=1e-12) and at[away > 0.23] == pytest.approx(1.0, rel=1e-12)
    given = [np.full(1000, 1.0), np.full(8000, 3.0)]
    again = shared.resampling.apply(given if last == "fine" else given[::-1], ambient_density=1.0)
    assert again.density_at(places)[away < 0.17] == pytest.approx(3.0, rel=1e-12)
