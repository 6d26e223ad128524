"""What `flow.read` takes for what: density, references, units, frames; what it refuses, with file, place and remedy."""

import os
import pickle

import fuzzing
import numpy as np
import pytest
import vtk_writers
import writers

import aerokernels
from aerokernels import flow
from aerokernels.flow.reading.planes.polygons import Polygons, quad_mesh


@pytest.fixture
def grid_file(tmp_path):
    """An even grid in x and y with rho, p, T and a scaled density."""
    x, y = np.linspace(0.0, 0.1, 13), np.linspace(0.0, 0.04, 9)
    values = writers.rho(*np.meshgrid(x, y, indexing="ij"))
    pressure = 287.0 * 250.0 * values
    np.savez(tmp_path / "a.npz", x=x, y=y, rho=values, p=pressure, T=np.full_like(values, 250.0), scaled=values / 0.5)
    return tmp_path / "a.npz"


AT = np.array([[0.0, 0.01, -0.05]])  # x = 0.05, y = 0.01 of the file: a node
TRUTH = float(writers.rho(0.05, 0.01))


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"density": "rho"},
        {"density": {"pressure": "p", "temperature": "T", "gas_constant": 287.0}},
        {"density": {"pressure": "p", "temperature": "T"}, "gas_constant": 287.0},
        {"density": "scaled", "reference": 0.5},
        {"density": "scaled", "reference": {"density": "0.5 kg/m3"}},
    ],
    ids=str,
)
def test_density(grid_file, given):
    assert flow.read(grid_file, **given).density_at(AT) == pytest.approx(TRUTH, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "at"),
    [
        ({"length_unit": "mm"}, 1e-3 * AT),
        ({"length_unit": 2.0}, 2.0 * AT),
        ({"reference": {"length": "50 mm"}}, 0.05 * AT),
        ({"frame": "-x"}, AT),
        ({"frame": {"flow": "x", "origin": (0.01, 0.0, 0.0)}}, AT + np.array([0.0, 0.0, 0.01])),
        ({"frame": {"optical": "+x"}}, -AT * [[1, -1, 1]]),
        ({"frame": {"optical": "y"}}, [[0.0, 0.05, 0.01]]),
        ({"frame": {"optical": "-y", "up": "-x"}}, [[0.0, -0.05, -0.01]]),
        ({"frame": {"optical": "-x", "rotation": "90 deg"}}, [[0.0, 0.05, 0.01]]),
        ({"frame": flow.Frame(optical=(0.6, 0.8, 0.0))}, None),
        ({"geometry": "axisymmetric"}, [[0.006, 0.008, -0.05]]),
    ],
    ids=str,
)
def test_frame_and_units(grid_file, given, at):
    field = flow.read(grid_file, **given)
    if at is None:  # z = 0.6 x + 0.8 y, y = 0.8 x - 0.6 y of the file: `up` turns so that its greatest part is positive
        at = [[0.0, 0.8 * 0.05 - 0.6 * 0.01, 0.6 * 0.05 + 0.8 * 0.01]]
    assert field.density_at(at) == pytest.approx(TRUTH, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"density": "roh"}, "there is no array 'roh': take one of rho, p, T, scaled"),
        ({"density": 3}, "density must be an array's name"),
        ({"frame": {"optical": "-w"}}, "'-w' is not an axis"),
        ({"frame": {"optical": "z"}}, "out of the plane"),
        ({"frame": {"optical": "x", "flow": "x"}}, "not both"),
        ({"frame": {"optical": "x", "up": "x"}}, "right angles"),
        ({"frame": {"look": "x"}}, "'look' is not known"),
        ({"frame": "y", "geometry": "axisymmetric"}, "axis of symmetry"),
        ({"length_unit": "kg"}, "kg"),
        ({"length_unit": -1.0}, "length_unit"),
        ({"reference": {"speed": 1.0}}, "'speed' is not known"),
        ({"ambient_density": -1.0}, "ambient_density"),
        ({"time": 3.0}, "one time only"),
        ({"geometry": "round"}, "'round' is not known"),
        ({"walls": ["dome"]}, "no patch 'dome'"),
        ({"tiem": 3.0}, "no argument 'tiem'"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_refusals(grid_file, given, message):
    with pytest.raises((ValueError, TypeError), match=message):
        flow.read(grid_file, **given)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("nothing.vtu", None, "no such file"),
        ("empty.vtu", b"", "empty"),
        ("a.docx", b"text", "no format is known"),
        ("a.csv", b"x,y,rho\n0,0\n", "line 2"),
        ("a.csv", b"x,y,rho\n0,0,1\n1,0,nan\n0,1,1\n1,1,1\n", "not finite.*point 1"),
        ("a.csv", b"x,y,rho\n0,0,1\n1,0,-1\n0,1,1\n1,1,1\n", "not positive.*-1.0 kg/m3"),
        ("a.csv", b"x,y,rho\n0,0,1\n1,0,1\n0,1,1\n0,1,1\n", "same place"),
        ("a.plt", b"#!TDV112\1\0\0\0", "the file ends before"),
        ("a.npz", b"PK\3\4rest", "it cannot be read"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, text, message):
    if text is not None:
        (tmp_path / name).write_bytes(text)
    with pytest.raises(flow.ReadError, match=message) as caught:
        flow.read(tmp_path / name)
    assert name in str(caught.value) and str(caught.value).count("\n") == 0


def su2_cells(folder, change):
    """The restart beside a mesh of SU2, text in both, whose lines of cells and points are changed."""
    restart = writers.su2(folder, binary=False)
    lines = (folder / "mesh.su2").read_text().splitlines()
    count = int(lines[1].split("=")[1])
    points = next(k for k, line in enumerate(lines) if line.startswith("NPOIN")) + 1
    cells = [line.split() for line in lines[2 : 2 + count]]
    change(cells, lines, points)
    lines[2 : 2 + count] = [" ".join(cell) for cell in cells]
    lines[1] = f"NELEM= {len(cells)}"
    (folder / "mesh.su2").write_text("\n".join(lines) + "\n")
    return restart


@pytest.mark.parametrize("triangles", [False, True])
def test_cells_listed_the_other_way_round_are_turned(tmp_path, triangles):
    """Set-up: a mesh of SU2; one with every third cell in reverse. Expected: the same field, and a note."""

    def turned(cells, lines, points):
        if triangles:
            cells[:] = [row for _, a, b, c, d, _ in cells for row in (["5", a, b, c], ["5", a, c, d])]
        if sound:
            return
        for cell in cells[::3]:
            cell[1 : (4 if triangles else 5)] = cell[1 : (4 if triangles else 5)][::-1]

    fields = []
    for sound in (True, False):
        (tmp_path / str(sound)).mkdir()
        fields.append(flow.read(su2_cells(tmp_path / str(sound), turned)))
    before, after = fields
    count = len(before.mesh.cells) if not triangles else len(before.mesh.cells) // 3
    assert f"{-(-count // 3)} of {count} cells were listed the other way round" in after.provenance
    assert "other way round" not in before.provenance
    at = np.column_stack([np.zeros(50), before.mesh.corners[::7].mean(axis=1)[:50]])
    assert after.density_at(at) == pytest.approx(before.density_at(at), rel=1e-14)


def four_cells(place, cells=((0, 1, 4, 3), (1, 2, 5, 4), (3, 4, 7, 6), (4, 5, 8, 7))):
    """The mesh of the four quadrilaterals of a square of side 2 whose middle point was moved, by way of polygons."""
    points = np.array([[x, y] for y in (0.0, 1.0, 2.0) for x in (0.0, 1.0, 2.0)])
    points[4] = place
    corners = np.array(cells).ravel()
    return quad_mesh(Polygons(points, np.arange(0, 17, 4), corners, np.array([1.0, 2.0, 3.0, 4.0]), "cell"), "planar")


def test_folded_cells_are_refused_and_dented_ones_cut():
    """Set-up: four cells around a point. Expected: beyond the diagonal of one it is cut into parts of its area.

    The area is 2 - 1.8 = 0.2. Beyond the corner of the cell it is refused, and a cell listed as a bow tie is.
    """
    mesh, density, _ = four_cells((1.8, 1.8))
    assert mesh.corner_weights[density == 4.0].sum() == pytest.approx(0.2, rel=1e-12)
    assert mesh.corner_weights.sum() == pytest.approx(4.0, rel=1e-12)
    with pytest.raises(ValueError, match="1 of 4 cells are folded over their neighbours, the first is cell 3"):
        four_cells((2.5, 2.5))
    with pytest.raises(ValueError, match="cell 1 is folded over itself"):
        four_cells((1.0, 1.0), ((0, 1, 4, 3), (1, 5, 2, 4), (3, 4, 7, 6), (4, 5, 8, 7)))


def test_the_error_travels_between_processes(tmp_path):
    with pytest.raises(flow.ReadError) as caught:
        flow.read(tmp_path / "nothing.vtu")
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is flow.ReadError and str(again) == str(caught.value)


def test_a_grid_around_a_body_closes_on_itself(tmp_path):
    """Set-up: an O-grid about a circle of 10 mm, which closes in a seam. Expected: the circle is a body."""
    angle, radius = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 41), np.linspace(0.01, 0.03, 9), indexing="ij")
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    x[-1], y[-1] = x[0], y[0]
    np.savez(tmp_path / "a.npz", x=x, y=y, rho=1.2 + 0.0 * x)
    field = flow.read(tmp_path / "a.npz")
    assert list(field.body.contains(np.array([[0.0, 0.0], [0.009, 0.0], [0.011, 0.0]]))) == [True, True, False]


def test_density_from_memory():
    """From xarray (an array is the density) and from a grid of VTK, as pyvista's are."""
    xarray = pytest.importorskip("xarray")
    y, z = np.linspace(-0.02, 0.02, 9), np.linspace(0.0, 0.1, 11)
    values = 1.2 + y[:, None] + 2.0 * z
    array = xarray.DataArray(values, dims=("y", "z"), coords={"y": y, "z": z}, attrs={"ambient_density": 1.1})
    field = aerokernels.DensityField.from_xarray(array)
    assert field.ambient_density == 1.1
    assert field.density_at([[5.0, 0.01, 0.05]]) == pytest.approx(1.31, rel=1e-12)
    pytest.importorskip("vtkmodules")
    field = aerokernels.DensityField.from_pyvista(vtk_writers.vtk_grid(cells=True), density="rho")
    assert isinstance(field, flow.CellDensity)
    with pytest.raises(TypeError, match="pyvista"):
        aerokernels.DensityField.from_pyvista(values)


@pytest.mark.parametrize("kind", fuzzing.KINDS)
def test_damaged_copies_are_read_or_refused(tmp_path, kind):
    """Set-up: 20 damaged copies of a sound file. Expected: a field of a gas, or a ValueError in one line."""
    counts = fuzzing.fuzz(tmp_path, kind, range(1000, 1020))
    assert counts["refused"] > counts["read"] / 2


@pytest.mark.parametrize("kind", ["vtu", "vtk", "hdf5", "netcdf"])
def test_damaged_copies_of_what_libraries_read(tmp_path, kind, readers_child):
    """The same where a library in C or C++ reads: its crash is the child's, and what it prints is an error."""
    pytest.importorskip("vtkmodules")
    counts = fuzzing.fuzz(tmp_path, kind, range(2015, 2025 if "AEROKERNELS_SLOW" in os.environ else 2018))
    assert counts["refused"] > 0
