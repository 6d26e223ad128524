"""Files as other programs write them: units beside arrays and in names, headings, orders of axes, blanked points."""

import struct
import warnings
from pathlib import Path

import cgns_writer
import h5py
import numpy as np
import pytest
import writers
import xarray

from aerokernels import DensityField, flow
from aerokernels.flow.reading import ReadError
from aerokernels.flow.reading.dataset import TETRAHEDRON, TRIANGLE, Block, Cells

X, Y = np.linspace(-0.02, 0.03, 11), np.linspace(-0.01, 0.02, 11)  # of equal length: order cannot be told by it
AT = np.random.default_rng(0).uniform([-0.019, -0.009], [0.029, 0.019], (20, 2))
R = 287.05


def rho(x, y):
    """Linear, so that the mesh holds it to rounding."""
    return 1.0 + 8.0 * x + 5.0 * y


GRID = rho(*np.meshgrid(X, Y, indexing="ij"))


def right(field: DensityField) -> bool:
    points = np.stack([0.0 * AT[:, 0], AT[:, 1], -AT[:, 0]], axis=1)  # z = -x
    return float(np.abs(field.density_at(points) - rho(*AT.T)).max()) < 1e-12


def table(names: str, columns, mark: str = ",", head: str = "") -> str:
    rows = zip(*(np.ravel(column).tolist() for column in columns), strict=True)
    return "\n".join([head + names, *(mark.join(map(repr, row)) for row in rows)]) + "\n"


PLACES = [axis.ravel() for axis in np.meshgrid(X, Y, indexing="ij")]
VALUES = GRID.ravel()


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (table("x,y,rho", [*PLACES, VALUES], head="# "), {}),  # NumPy's savetxt
        (table("x, y, rho", [*PLACES, VALUES], " ", head="# "), {}),
        (table(",x,y,rho", [np.arange(121), *PLACES, VALUES]), {}),  # pandas with its index
        (table("x;y;rho", [*PLACES, VALUES], ";").replace(".", ","), {}),  # where the comma is the decimal mark
        (table("X [mm],Y [mm],Density [g/cm^3]", [1e3 * PLACES[0], 1e3 * PLACES[1], 1e-3 * VALUES]), {}),
        (table("X [m],Y [m],rho", [1e3 * PLACES[0], 1e3 * PLACES[1], VALUES]), {"length_unit": "mm"}),
        (table("x (axial),y,rho", [*PLACES, VALUES]), {}),
        (
            table("x,y,p (kPa),T [°C]", [*PLACES, 1e-3 * R * 300.0 * VALUES, np.full(121, 26.85)]),
            {"gas_constant": R},
        ),
        (table("x,y,rho [g/cm3]", [*PLACES, VALUES]), {"reference": 1.0}),
    ],
)
def test_tables(tmp_path: Path, text: str, options):
    """Set-up: a linear density on a grid, as tables of several programs. Expected: the same, to rounding."""
    path = tmp_path / "flow.csv"
    path.write_text(text, encoding="utf-8")
    assert right(flow.read(path, **options))


def test_labelled_arrays_in_any_order_and_unit():
    """Set-up: dimensions in another order than the axes, equal in length; units; dates; a curvilinear mesh."""
    plain = xarray.Dataset({"rho": (("y", "x"), GRID.T)}, {"x": X, "y": Y})
    assert right(DensityField.from_xarray(plain))
    scaled = plain.assign_coords(x=("x", 1e3 * X, {"units": "mm"}), y=("y", 1e3 * Y, {"units": "mm"}))
    assert right(DensityField.from_xarray(scaled))
    assert "units of 0.001 m" in DensityField.from_xarray(scaled).provenance
    assert right(DensityField.from_xarray(scaled, length_unit="mm"))  # said twice is not twice as small
    assert DensityField.from_xarray(scaled, frame={"origin": (1.0, 0.0, 0.0)}).box[1][1] == pytest.approx(21e-3)
    beside = xarray.Dataset({"rho": (("j", "i"), GRID.T)}, {"x": ("i", X), "y": ("j", Y)})
    assert right(DensityField.from_xarray(beside))
    places = dict(zip("xy", np.meshgrid(X, Y), strict=True))  # over (j, i), the density over (i, j)
    curved = xarray.Dataset({"rho": (("i", "j"), GRID)}, {name: (("j", "i"), own) for name, own in places.items()})
    assert right(DensityField.from_xarray(curved))
    days = np.datetime64("2026-01-01") + np.array([0, 2], "timedelta64[s]")
    timed = xarray.concat([0.5 * plain, plain], "time").assign_coords(time=days)
    assert right(DensityField.from_xarray(timed, time=2.0)) and not right(DensityField.from_xarray(timed, time="first"))
    heavy = plain.assign(rho=(1e-3 * plain.rho).assign_attrs(units="gram / centimeter ** 3"))
    assert right(DensityField.from_xarray(heavy))
    with pytest.raises(ReadError, match="the unit of 'rho'"):
        DensityField.from_xarray(plain.assign(rho=plain.rho.assign_attrs(units="code_density")))


def foam_field(case: Path, name: str, dimensions: str, values: str, before: str = "") -> None:
    head = writers.foam_header("volScalarField", name, False).decode()
    text = f"dimensions [{dimensions}];\n{before}\ninternalField {values};\nboundaryField\n{{\n}}\n"
    (case / "0.5" / name).write_text(head + text)


def test_foam_fields_as_people_write_them(tmp_path: Path):
    """Uniform values, lists of one value, commented-out gases, kinematic pressures, values by name."""
    case = writers.foam_wedge(tmp_path / "case", wedge=False)
    (case / "0.5" / "rho").unlink()
    (case / "constant" / "thermophysicalProperties").write_text("// molWeight 11640.3;\nmolWeight 28.9;\n")
    for first in ("uniform 101325", f"nonuniform List<scalar> {30 * 20}{{101325}}"):
        foam_field(case, "p", "1 -1 -2 0 0 0 0", first)
        foam_field(case, "T", "0 0 0 1 0 0 0", "uniform 250")
        assert flow.read(case).density == pytest.approx(101325.0 / (8314.4626 / 28.9 * 250.0), rel=1e-9)
    foam_field(case, "p", "0 2 -2 0 0 0 0", "uniform 1e5")
    with pytest.raises(ReadError, match="the unit of 'p'"):
        flow.read(case)
    foam_field(case, "T", "0 0 0 1 0 0 0", "uniform $temperature")
    with pytest.raises(ReadError, match="uniform value"):
        flow.read(case, density="T")


def test_blanked_points_of_a_volume_are_no_flow(tmp_path: Path):
    """Set-up: a Plot3D volume with a cube blanked by iblank, where the solution is 0, as solvers leave it.

    Expected: the density about it linear as given, and a body where the blanked points and the cells at them are.
    """
    axis = np.linspace(0.0, 1.0, 11)
    x, y, z = (one.ravel(order="F") for one in np.meshgrid(axis, axis, axis, indexing="ij"))
    blank = (np.abs(np.stack([x, y, z]) - 0.5) < 0.15).all(axis=0)
    values = np.where(blank, 0.0, 1.0 + x + 2.0 * y + 3.0 * z)

    def record(*parts):
        data = b"".join(part.tobytes() for part in parts)
        return struct.pack("<I", len(data)) + data + struct.pack("<I", len(data))

    shape = record(np.array([11, 11, 11], "<i4"))
    (tmp_path / "a.xyz").write_bytes(shape + record(x, y, z, np.where(blank, 0, 1).astype("<i4")))
    (tmp_path / "a.q").write_bytes(shape + record(np.array([2.0, 0.0, 1e6, 0.0])) + record(*[values] * 5))
    found = flow.read(tmp_path / "a.xyz", spacing=0.1)
    at = np.array([[0.15, 0.5, 0.5], [0.5, 0.25, 0.95]])
    assert np.abs(found.density_at(at) - (1.0 + at @ [1.0, 2.0, 3.0])).max() < 1e-12
    assert found.body is not None
    assert np.allclose([found.body.vertices.min(axis=0), found.body.vertices.max(axis=0)], [[0.3] * 3, [0.7] * 3])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"mesh": "a.su2"}, "takes no mesh: that belongs to SU2"),
        ({"solution": "a.q"}, "takes no solution"),
        ({"variables": {"x": 5.0, "y": 3.0}}, "the ends of x are 5.0"),
        ({"gas_constant": -1.0}, "gas_constant must be positive"),
    ],
)
def test_options_that_would_be_passed_over_are_refused(tmp_path: Path, options, told: str):
    np.savez(tmp_path / "a.npz", x=X, y=Y, rho=GRID)
    with pytest.raises(ValueError, match=told):
        flow.read(tmp_path / "a.npz", **options)


def test_cells_beside_the_flow_need_no_density():
    """Set-up: a cube of tetrahedra, and one of their faces as a cell of its own, as generators leave it, with NaN."""
    corners = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])
    points = np.array([[i, j, k] for k in (0.0, 1.0) for j in (0.0, 1.0) for i in (0.0, 1.0)])
    cells = Cells(
        np.array([TETRAHEDRON] * 6 + [TRIANGLE], np.uint8),
        np.append(4 * np.arange(7), 27),
        np.concatenate([corners.ravel(), [0, 1, 3]]),
    )
    block = Block(points, cells, cell_data={"rho": np.append(np.full(6, 1.3), np.nan)})
    assert np.allclose(writers.field([block], density="rho", spacing=0.25).density, 1.3, rtol=1e-14)


@pytest.mark.parametrize(("order", "species"), [("<", 0), (">", 3)])
def test_a_q_file_of_overflow_is_read(tmp_path, order, species):
    """Set-up: two grids with 6 or 9 variables, records of sizes and of the run's conditions as OVERFLOW writes them.

    Expected: its density. It was rejected as damaged.
    """
    count = 6 + species
    axes = [np.meshgrid(*np.ogrid[low : low + 1 : 4j, 0:1:3j, 0:1:3j], indexing="ij") for low in (0.0, 1.0)]
    density = [1.0 + 0.1 * x + 0.01 * z for x, _, z in axes]

    def record(*parts):
        data = b"".join(np.asarray(values, order + kind).tobytes() for values, kind in parts)
        mark = np.array(len(data), f"{order}i4").tobytes()
        return mark + data + mark

    def flat(values):
        return values.ravel(order="F"), "f8"

    sizes = [4, 3, 3, 4, 3, 3]
    grid = record(([2], "i4")) + record((sizes, "i4")) + b"".join(record(*map(flat, own)) for own in axes)
    (tmp_path / "a.xyz").write_bytes(grid)
    solution = record(([2], "i4")) + record(([*sizes, count, species], "i4"))
    for own in density:
        solution += record((np.ones(7), "f8"), ([0], "i4"), (np.ones(6 + max(species, 2)), "f8"))
        solution += record(*[flat(own if k == 0 else 2.0 + k + own) for k in range(count)])
    (tmp_path / "a.q").write_bytes(solution)
    field = flow.read(tmp_path / "a.xyz")
    at = np.array([[0.5, 0.5, 0.25], [1.6, 0.3, 0.8]])
    assert field.density_at(at) == pytest.approx(1.0 + 0.1 * at[:, 0] + 0.01 * at[:, 2])


FREESTREAM = "REF_DIMENSIONALIZATION= FREESTREAM_VEL_EQ_MACH\nFREESTREAM_PRESSURE= 4006.88\n"


@pytest.mark.parametrize(
    ("stated", "reference"),
    [
        (FREESTREAM + "FREESTREAM_TEMPERATURE= 69.8 % K", 4006.88 / (287.058 * 69.8)),
        (FREESTREAM + "FLUID_MODEL= IDEAL_GAS\nGAS_CONSTANT= 300\nFREESTREAM_TEMPERATURE= 100", 4006.88 / 3e4),
        (FREESTREAM + "FREESTREAM_OPTION= DENSITY_FS\nFREESTREAM_DENSITY= 0.05", 0.05),
        (FREESTREAM + "SOLVER= RANS\nFREESTREAM_TEMPERATURE= 100\nREYNOLDS_NUMBER= 1e6", None),
        (FREESTREAM + "FREESTREAM_TEMPERATURE= 0", None),
    ],
)
def test_the_free_stream_of_a_configuration_of_su2_is_its_unit_of_density(tmp_path, stated, reference):
    """Expected: multiples of p / (R T), as SU2's template says, without a warning; else one that asks for it.

    A reference that the caller gives counts instead. Two configurations that disagree: the warning.
    """
    path = writers.su2(tmp_path)
    plain = flow.read(path, reference=1.0).density
    (tmp_path / "a.cfg").write_text(stated)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        field = flow.read(path)
        given = flow.read(path, reference=0.5)
    np.testing.assert_allclose(field.density, (reference or 1.0) * plain, rtol=1e-15)
    np.testing.assert_allclose(given.density, 0.5 * plain, rtol=1e-15)
    assert len(warned) == (reference is None)
    (tmp_path / "b.cfg").write_text(FREESTREAM + "FREESTREAM_TEMPERATURE= 200")
    with pytest.warns(UserWarning, match="give its reference"):
        flow.read(path)


@pytest.mark.parametrize("binary", [True, False])
def test_a_mesh_of_su2_in_cgns(tmp_path, binary):
    """Set-up: the cells and points of SU2's mesh in a CGNS file, the restart beside it.

    Expected: the field with the mesh as .su2. Points in another order than the restart's, or a second zone: rejected.
    """
    pytest.importorskip("vtkmodules")
    path = writers.su2(tmp_path, binary=binary)
    expected = flow.read(path)
    (tmp_path / "mesh.su2").unlink()
    x, y = (own.ravel() for own in writers.grid())
    for moved in (0, 1):
        axes = [np.roll(own, moved) for own in (x, y)]
        corners = (writers.quads() + moved) % len(x)
        file = cgns_writer.cgns(tmp_path / "a.cgns", axes, np.zeros(len(x)), [], elements=[(7, corners)])
        if not moved:
            field = flow.read(path, mesh=file)
            at = np.column_stack([np.zeros(9), np.linspace(0.2, 0.8, 9), -np.linspace(0.2, 0.8, 9)])
            assert field.density_at(at) == pytest.approx(expected.density_at(at), abs=1e-15)
            with h5py.File(file, "a") as root:
                base = next(own for own in root.values() if isinstance(own, h5py.Group) and own.keys() - {" data"})
                zone = next(name for name, own in base.items() if own.attrs.get("label", b"")[:6] == b"Zone_t")
                base.copy(zone, "Zone 2")
            with pytest.raises(ReadError, match="it has 2 zones, and SU2 reads a mesh in CGNS of one"):
                flow.read(path, mesh=file)
            continue
        with pytest.raises(ReadError, match=r"its points are not where the mesh has them \(column x\)"):
            flow.read(path, mesh=file)
    file.write_bytes(b"\x89HDF\r\n")
    with pytest.raises(ReadError, match=r"a\.cgns: it is not a CGNS file"):
        flow.read(path, mesh=file)


def test_an_order_of_axes_that_nothing_tells(tmp_path):
    """Set-up: numpy.meshgrid's arrays over as many x as y, in a plane and in a volume.

    Expected: a warning that names the order taken and the option; with the option the formula. Arrays with the place
    of each sample need none.
    """
    x, y, z = np.linspace(0.0, 0.8, 9), np.linspace(-0.1, 0.3, 9), np.linspace(0.0, 0.2, 5)
    axes = {"x": x, "y": y}
    mesh = dict(zip("xy", np.meshgrid(x, y), strict=True))
    solid = dict(zip("xyz", np.meshgrid(x, y, z), strict=True))

    def written(name, arrays):
        np.savez(tmp_path / f"{name}.npz", **arrays)
        return tmp_path / f"{name}.npz"

    flat = written("flat", {**axes, "rho": 1.0 + mesh["x"] + 0.1 * mesh["y"]})
    full = written("full", {**axes, "z": z, "rho": 1.0 + solid["x"] + 0.1 * solid["y"] + 0.01 * solid["z"]})
    for path, told, order in ((flat, "xy", "yx"), (full, "xyz", "yxz")):
        with pytest.warns(UserWarning, match=rf"order = '{told}', or order = '{order}' for those of numpy\.meshgrid"):
            wrong = flow.read(path)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            right_one = flow.read(path, order=order)
            assert np.array_equal(flow.read(path, order=told).density, wrong.density)
        at = np.array([[0.1, 0.2, -0.1], [0.1, -0.1, -0.7]]) if path is flat else np.array([[0.7, 0.2, 0.1]])
        along = (-at[:, 2], at[:, 1], 0.0) if path is flat else tuple(at.T)
        expected = 1.0 + along[0] + 0.1 * along[1] + 0.01 * along[2]
        assert right_one.density_at(at) == pytest.approx(expected) != wrong.density_at(at)
    with pytest.raises(ValueError, match=r"order is 'yz', and its axes are x, y"):
        flow.read(flat, order="yz")
    with pytest.raises(ValueError, match=r"order is 3"):
        flow.read(flat, order=3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flow.read(written("places", {**mesh, "rho": 1.0 + mesh["x"]}))
