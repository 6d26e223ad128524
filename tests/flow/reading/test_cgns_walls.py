"""Walls of CGNS files as bodies: of planes and volumes, by ranges, elements and points."""

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow.reading.formats import load

pytest.importorskip("h5py")
pytest.importorskip("vtkmodules")
import cgns_writer
import h5py
import writers


def ring():
    """A half ring about the origin from radius 1 to 2, structured: i along the circle, j outward; [j, i]."""
    angle, radius = np.linspace(0.0, np.pi, 33), np.linspace(1.0, 2.0, 9)
    radius, angle = np.meshgrid(radius, angle, indexing="ij")
    return radius * np.cos(angle), radius * np.sin(angle)


@pytest.mark.parametrize(
    ("kind", "parts", "families"),
    [
        ("BCWallViscousHeatFlux", [("PointRange", "IndexRange_t", [[1, 1], [33, 1]])], ()),
        (
            "FamilySpecified",
            [("PointRange", "IndexRange_t", [[1, 1], [32, 1]]), ("GridLocation", "GridLocation_t", "JFaceCenter"),
             ("FamilyName", "FamilyName_t", "nose")],
            [("nose", "BCWallInviscid")],
        ),
    ],
)  # fmt: skip
def test_a_wall_of_a_plane(tmp_path, kind, parts, families):
    """A range of a structured zone. Expected: the corners of the body are the 33 points at radius 1, to 1e-12."""
    x, y = ring()
    away = ("far", "BCFarfield", [("PointRange", "IndexRange_t", [[1, 9], [33, 9]])])
    path = cgns_writer.cgns(
        tmp_path / "a.cgns", (x, y), 1.0 + 0.1 * y, [("nose", kind, parts), away], families=families
    )
    field = flow.read(path, geometry="axisymmetric")
    assert [(one, two) for one, two in flow.contents(path).patches] == [("nose", "wall"), ("far", "BCFarfield")]
    assert np.hypot(*field.body.profile.T) == pytest.approx(np.ones(33), abs=1e-12)


@pytest.mark.parametrize("by", ["elements", "points", "range"])
def test_a_wall_of_a_volume(tmp_path, by):
    """A cube in the middle of a cube, by its faces. Expected: its volume 0.2^3, to 1e-12."""
    n = 5
    axis = np.linspace(0.0, 1.0, n + 1)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    index = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    offsets = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = np.stack([index[a : n + a, b : n + b, c : n + c].ravel() for a, b, c in offsets], axis=1)
    middle = (n**3 - 1) // 2
    sides = np.array([(0, 3, 2, 1), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (4, 5, 6, 7)])
    faces = cells[middle][sides]
    rest = np.delete(cells, middle, axis=0)
    first = len(rest) + 1
    parts = {
        "elements": [("PointList", "IndexArray_t", [[k] for k in range(first, first + 6)]),
                     ("GridLocation", "GridLocation_t", "FaceCenter")],
        "points": [("PointList", "IndexArray_t", np.unique(faces)[:, None] + 1)],
        "range": [("ElementRange", "IndexRange_t", [[first], [first + 5]])],
    }[by]  # fmt: skip
    path = cgns_writer.cgns(
        tmp_path / "a.cgns", (x.ravel(), y.ravel(), z.ravel()), np.full(x.size, 1.2), [("box", "BCWall", parts)],
        elements=[(17, rest), (7, faces)],
    )  # fmt: skip
    body = flow.read(path, walls=["box"]).body
    assert flow.contents(path).patches == (("box", "wall"),)
    a, b, c = body.vertices[body.triangles].transpose(1, 0, 2)
    assert abs(np.einsum("nk,nk->n", a, np.cross(b, c)).sum() / 6.0) == pytest.approx(0.2**3, rel=1e-12)
    with pytest.raises(ValueError, match=r"no patch 'sphere'.*the patches are box"):
        flow.read(path, walls=["sphere"])


CUBE = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], indexing="ij")[::-1], axis=-1).reshape(-1, 3)
HEXAHEDRON, SIDES = [0, 1, 3, 2, 4, 5, 7, 6], np.array([(0, 2, 3, 1), (4, 5, 7, 6)])
TRIANGLES = np.array([(0, 1, 5), (0, 5, 4)])


@pytest.mark.parametrize("form", ["mixed", "polygons", "polygons with offsets"])
def test_faces_of_several_kinds_in_one_section(tmp_path, form):
    """Two squares and two triangles of a cube's surface. Expected: their areas 1, 1, 1/2, 1/2, to 1e-12."""
    faces = [*SIDES, *TRIANGLES]
    before = {"mixed": {4: 7, 3: 5}, "polygons": {4: 4, 3: 3}}.get(form, {})  # CGNS' types, or numbers of corners
    flat = np.concatenate([[*([before[len(face)]] if before else []), *(face + 1)] for face in faces])
    named = ("walls", "BCWall", [("PointRange", "IndexRange_t", [[2], [5]]),
                                 ("GridLocation", "GridLocation_t", "FaceCenter")])  # fmt: skip
    path = cgns_writer.cgns(
        tmp_path / "a.cgns", tuple(CUBE.T), np.ones(8), [named], elements=[(17, np.array([HEXAHEDRON]))]
    )
    with h5py.File(path, "r+") as file:
        section = cgns_writer.node(file["Base/Zone"], "Faces", "Elements_t", [20 if form == "mixed" else 22, 0])
        cgns_writer.node(section, "ElementRange", "IndexRange_t", [2, 5])
        cgns_writer.node(section, "ElementConnectivity", "DataArray_t", flat)
        if form == "polygons with offsets":
            cgns_writer.node(section, "ElementStartOffset", "DataArray_t", [0, 4, 8, 11, 14])
    (patch,) = load(path, None, {}).patches
    corners = np.split(patch.polygons.points, patch.polygons.start[1:-1])
    areas = [np.linalg.norm(np.cross(own[2] - own[0], own[3 % len(own)] - own[1])) / 2.0 for own in corners]
    assert sorted(areas) == pytest.approx([0.5, 0.5, 1.0, 1.0], abs=1e-12) and patch.kind == "wall"


@pytest.mark.parametrize("corner", [0, 10])
def test_a_corner_that_is_not_there_is_no_other_point(corner, tmp_path):
    """Set-up: a wall of one edge between nine points, numbered from 1, that ends at point 0 or 10.

    Expected: refused with the patch's name; point 0 was taken for the last one.
    """
    x, y = np.meshgrid(np.arange(3.0), np.arange(3.0))
    parts = [("PointRange", "IndexRange_t", [5, 5]), ("GridLocation", "GridLocation_t", "EdgeCenter")]
    path = cgns_writer.cgns(
        tmp_path / "a.cgns", (x.ravel(), y.ravel()), np.ones(9), [("nose", "BCWall", parts)],
        elements=[(7, writers.quads(3, 3)), (3, np.array([[0, corner - 1]]))],
    )  # fmt: skip
    with pytest.raises(ValueError, match="'nose' names points that are not there"):
        load(path, None, {})
