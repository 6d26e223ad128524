"""OpenFOAM cases in parts and in other states, structured volumes, recognition of formats, series of even grids."""

import re
from dataclasses import replace

import numpy as np
import pytest
import writers
import xarray
from typer.testing import CliRunner

from aerokernels import flow
from aerokernels.cli import app
from aerokernels.flow.reading.dataset import Block, Dataset, ReadError
from aerokernels.flow.reading.density import Reference
from aerokernels.flow.reading.formats import format_of
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.read import field_of, reading_of
from aerokernels.flow.reading.readers import foam_file
from aerokernels.flow.series_sources import open_series
from aerokernels.flow.wall_density import WallDensity


def test_a_decomposed_case_is_read_whole(tmp_path):
    """Two parts side by side along x. Expected: the cells of both, each with the density of its own place there."""
    case, length = tmp_path / "case", float(np.ptp(writers.grid()[0]))
    for number in (0, 1):
        part = writers.foam_wedge(case / f"processor{number}", wedge=False)
        file = foam_file.FoamFile(part / "constant" / "polyMesh" / "points")
        points = file.numbers(file.scalar, 3) + np.array([number * length, 0.0, 0.0])
        body = writers.foam_header("vectorField", "points", False) + writers.foam_list(points, False)
        (part / "constant" / "polyMesh" / "points").write_bytes(body)
    field = flow.read(case)
    corners = field.mesh.corners.mean(axis=1)
    assert len(corners) == 2 * (writers.NI - 1) * (writers.NJ - 1) and "decomposed in 2" in field.provenance
    expected = writers.rho((-corners[:, 1]) % length, corners[:, 0])
    assert np.abs(field.density - expected).max() < 1e-13
    (case / "a.foam").write_text("")
    (case / "system").mkdir()
    (case / "system" / "controlDict").write_text("")
    for path in (case / "a.foam", case / "system" / "controlDict"):
        assert np.array_equal(flow.read(path).density, field.density)
    series = open_series(case)
    assert list(series.time) == [0.5] and np.array_equal(series[0].density, field.density)


def test_a_number_of_a_cell_beyond_all_faces_is_refused(tmp_path):
    """Set-up: the last owner is cell 1215752098, as damage made it; arrays of as many cells took 12 GB and a minute."""
    case = writers.foam_wedge(tmp_path / "case")
    path = case / "constant" / "polyMesh" / "owner"
    damaged = re.sub(rb"\d+(\s*\)\s*)$", rb"1215752098\1", path.read_bytes())
    path.write_bytes(damaged)
    assert b"1215752098" in damaged
    with pytest.raises(ReadError, match="owners and neighbours of faces do not agree"):
        flow.read(case)


@pytest.mark.parametrize(
    ("name", "body", "told"),
    [
        ("owner", "2(0 0)", "it names owners of 2 faces, there are"),
        ("neighbour", "1(0)", "a face has the same cell on both sides"),
        ("boundary", "1(wall { type wall; nFaces 9999; startFace 1; })", "patch wall has faces that are not there"),
        ("points", None, "there is no such file"),
    ],
)
def test_meshes_that_do_not_agree_with_themselves(tmp_path, name, body, told):
    case = writers.foam_wedge(tmp_path / "case")
    path = case / "constant" / "polyMesh" / name
    if body is None:
        path.unlink()
    else:
        path.write_bytes(writers.foam_header("labelList", name, False) + body.encode())
    with pytest.raises(ReadError, match=told):
        flow.read(case)


ABOUT_Y = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
ASKEW = np.array([[2.0, -2.0, 1.0], [1.0, 2.0, 2.0], [-2.0, -1.0, 2.0]]) / 3.0


def test_wedges_about_another_line_are_refused(tmp_path):
    """Set-up: a wedge turned about z, moved along its axis, moved away from it, turned askew.

    Expected: the first two as before; the others are refused, whose radii would be counted from another line.
    """
    plain = flow.read(writers.foam_wedge(tmp_path / "case"))
    for turn, shift in ((ABOUT_Y, (0.0, 0.0, 0.0)), (None, (0.7, 0.0, 0.0))):
        found = flow.read(writers.foam_wedge(tmp_path / f"good {shift}", turn=turn, shift=shift))
        assert found.geometry == "axisymmetric" and np.array_equal(found.density, plain.density)
        assert found.mesh.vertices[:, 0] == pytest.approx(plain.mesh.vertices[:, 0], abs=1e-9)
    for turn, shift in ((None, (0.0, 0.3, 0.0)), (ASKEW, (0.0, 0.0, 0.0))):
        with pytest.raises(ReadError, match="the sides of the wedge meet in a line through"):
            flow.read(writers.foam_wedge(tmp_path / f"bad {shift}", turn=turn, shift=shift))


def test_a_plane_askew_in_its_case(tmp_path):
    """Set-up: a case one cell thick in a plane that no axis is across. Expected: the densities and areas as before."""
    plain = flow.read(writers.foam_wedge(tmp_path / "case", wedge=False))
    found = flow.read(writers.foam_wedge(tmp_path / "askew", wedge=False, turn=ASKEW))
    assert found.geometry == "planar" and np.array_equal(found.density, plain.density)
    areas = [field.mesh.corner_weights.sum(axis=1) for field in (found, plain)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)


def test_cases_in_other_states(tmp_path):
    case = writers.foam_wedge(tmp_path / "case")
    moved = case / "0.5" / "polyMesh"
    moved.mkdir()
    (moved / "points").write_text("")
    with pytest.raises(ReadError, match="the mesh moves"):
        flow.read(case)
    (moved / "points").unlink()
    moved.rmdir()
    (case / "1.5").mkdir()  # a time of which nothing has been written yet
    (case / "1.5" / ".rho").write_text("")
    (case / "1.5" / "rho~").write_text("")
    assert flow.contents(case).times == (0.5,)
    for entry in (case / "0.5").iterdir():
        entry.unlink()
    with pytest.raises(ReadError, match="the case has no fields at any time"):
        flow.read(case)
    (tmp_path / "bare" / "system").mkdir(parents=True)
    (tmp_path / "bare" / "system" / "controlDict").write_text("")
    with pytest.raises(ReadError, match=r"there is no constant/polyMesh"):
        flow.read(tmp_path / "bare")
    with pytest.raises(ValueError, match="there is no constant/polyMesh"):
        open_series(tmp_path / "bare")


def structured(blank=None, density=None):
    """A skewed grid of 5 x 4 x 3 points, the first index fastest; density linear in space."""
    k, j, i = np.meshgrid(np.linspace(0, 1, 3), np.linspace(0, 1, 4), np.linspace(0, 1, 5), indexing="ij")
    points = np.stack([i + 0.1 * j, j, k + 0.1 * i], axis=-1).reshape(-1, 3)
    rho = 1.0 + points @ [0.3, -0.2, 0.1] if density is None else density
    return Block(points, shape=(5, 4, 3), point_data={"rho": rho}, blank=blank)


def read(*blocks):
    taken = reading_of("FILE", Dataset(list(blocks), "test"), None, Frame(), 1.0, Reference(), None, None, None)
    return field_of(taken, 0.1)


def test_a_structured_volume_keeps_a_linear_density():
    """Expected: the density at points inside, to 1e-12; the same in one block and with a block behind it."""
    inside = np.random.default_rng(1).uniform(0.3, 0.7, (50, 3))
    assert read(structured()).density_at(inside) == pytest.approx(1.0 + inside @ [0.3, -0.2, 0.1], abs=1e-12)
    blank = np.zeros(4 * 3 * 2, bool)
    blank[0] = True  # of a cell in the corner
    holed = read(structured(blank=blank))
    assert holed.density_at(inside) == pytest.approx(1.0 + inside @ [0.3, -0.2, 0.1], abs=1e-12)
    assert holed.resampling.outside_share > read(structured()).resampling.outside_share


def test_how_a_format_is_told(tmp_path):
    (tmp_path / "folder").mkdir()
    for name, head, options, expected in (
        ("a.plt", b"x\0y", {}, "Tecplot binary"),
        ("a.plt", b"TITLE", {}, "Tecplot ASCII"),
        ("a.bin", b"\x89HDF\r\n\x1a\n rest", {}, "HDF5"),
        ("a.bin", b"\x89HDF\r\n\x1a\n CGNS", {}, "CGNS"),
        ("a.bin", b"grid", {"solution": "a.q"}, "Plot3D"),
        ("a.bin", b"grid", {}, "no format is known for the name's end '.bin'"),
        ("a.bin", b"", {}, "the file is empty"),
        ("folder", None, {}, "the folder is not an OpenFOAM case"),
    ):
        if head is not None:
            (tmp_path / name).write_bytes(head)
        if expected[0].islower():
            with pytest.raises(ReadError, match=expected):
                format_of(tmp_path / name, options)
        else:
            assert format_of(tmp_path / name, options).name == expected


def grid(time=(0.0, 1.0), y=(0.0, 1.0, 2.0), z=(0.0, 1.0, 2.0), **changes) -> xarray.DataArray:
    coordinates = {"time": list(time), "y": list(y), "z": list(z)}
    values = np.ones([len(one) for one in coordinates.values()])
    return xarray.DataArray(values, coordinates, ["time", "y", "z"], attrs={"ambient_density": 1.2, **changes})


def test_times_of_a_calendar_are_counted_from_the_first():
    days = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:02"], "datetime64[ns]")
    assert list(open_series(grid().assign_coords(time=days)).time) == [0.0, 2.0]
    assert list(open_series(grid().assign_coords(time=days - days[0])).time) == [0.0, 2.0]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (lambda: grid(y=(0.0,)), "axis y needs at least two nodes"),
        (lambda: grid(z=(0.0, 1.0, 3.0)), "the nodes of z do not increase evenly"),
        (lambda: grid().drop_vars("y"), "axis y has no coordinate"),
        (lambda: grid().drop_vars("time"), "axis time has no coordinate"),
        (lambda: grid(ambient_density=None).assign_attrs(), "give ambient_density|NoneType"),
        (lambda: grid().isel(time=0), "and no time"),
        (lambda: grid().rename(y="a"), "rename them to time and x, y, z"),
        (lambda: xarray.Dataset({"p": grid()}), "no variable density, rho or the like; it holds p"),
        (lambda: grid(units="kg"), "the unit of"),
    ],
)
def test_grids_that_make_no_series(given, told):
    with pytest.raises(ValueError, match=told):
        open_series(given())


def test_fields_tells_what_lines_will_lack(tmp_path, monkeypatch):
    """Set-up: a plane case of OpenFOAM. Expected: `fields` tells the numbers of its index field, and the remedy.

    A file of values at points has no averages, and nothing is reported; nor is it of many cells that take long to keep.
    """
    case = writers.foam_wedge(tmp_path / "case", wedge=False)
    read, wall = flow.read, WallDensity([[0.0, 0.0]], [1.0])
    told = read(case).index_field().averages_lacking
    assert told.rows_max > 1e-5
    shown = CliRunner(env={"COLUMNS": "1000"}).invoke(app, ["fields", str(case)])
    assert shown.exit_code == 0 and told.in_words() in shown.output and 'interpolation = "conserving"' in shown.output
    monkeypatch.setattr("aerokernels.commands.listing.MOST_MEASURED", 10)
    assert told.in_words() in CliRunner(env={"COLUMNS": "1000"}).invoke(app, ["fields", str(case)]).output
    monkeypatch.setattr("aerokernels.flow.read", lambda *given, **named: replace(read(*given, **named), wall=wall))
    assert "not measured above " in CliRunner(env={"COLUMNS": "1000"}).invoke(app, ["fields", str(case)]).output
    monkeypatch.undo()
    points = CliRunner().invoke(app, ["fields", str(writers.tecplot_text(tmp_path / "a.dat"))])
    assert points.exit_code == 0 and "averages" not in points.output
