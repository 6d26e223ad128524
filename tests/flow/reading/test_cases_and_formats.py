"""OpenFOAM cases in parts and in other states, structured volumes, recognition of formats, series of even grids."""

import re

import numpy as np
import pytest
import writers

from aerokernels import flow
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.formats import format_of
from aerokernels.flow.reading.readers import foam_file
from aerokernels.flow.series_sources import open_series


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
