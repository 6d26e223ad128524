"""Bodies of walls: plates, nozzles, several of them, and surfaces of any faces; what bounds nothing is refused."""

import numpy as np
import pytest
import writers

from aerokernels import QuadMesh
from aerokernels.flow.reading.dataset import HEXAHEDRON, Block, Cells, Patch, Polygons, ReadError
from aerokernels.flow.reading.planes.plane import wall_body


def mesh(geometry: str = "planar", low: float = 0.0) -> QuadMesh:
    return QuadMesh.structured(
        *np.meshgrid(np.linspace(low, 1.0, 11), np.linspace(0.0, 2.0, 21), indexing="ij"), geometry
    )


def edges(points) -> np.ndarray:
    points = np.asarray(points, float)
    return np.stack([points[:-1], points[1:]], axis=1)


def test_a_plate_has_its_solid_behind_it():
    """A straight wall below the flow y > 0. Expected: the body lies below it, a tenth of the field deep."""
    body = wall_body(edges([(0.0, z) for z in np.linspace(0.5, 1.5, 6)]), mesh())
    assert body.contains(np.array([[-0.05, 1.0]])).all()
    assert not body.contains(np.array([[0.05, 1.0], [-0.15, 1.0], [-0.05, 1.9], [-0.05, 0.1]])).any()


def test_a_nozzle_has_its_solid_outside():
    """An axisymmetric wall at r = 1 round the flow. Expected: air within, the body from 1 m to 1.1 m."""
    body = wall_body(edges([(1.0, z) for z in np.linspace(0.0, 2.0, 6)]), mesh("axisymmetric"))
    assert body.contains(np.array([[1.05, 1.0]])).all() and not body.contains(np.array([[0.5, 1.0], [1.2, 1.0]])).any()


AXIS = np.linspace(0.0, 1.0, 9)
POINTS = np.stack([a.ravel() for a in np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")[::-1]], axis=1)
INDEX = np.arange(729).reshape(9, 9, 9)
ORDER = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
BRICKS = np.stack([INDEX[a : 8 + a, b : 8 + b, c : 8 + c].ravel() for a, b, c in ORDER], axis=1)
KEEP = np.abs(POINTS[BRICKS].mean(axis=1) - 0.5).max(axis=1) > 0.2
LOW, HIGH = 0.375, 0.625
HOLE = np.array([[(LOW, HIGH)[k] for k in corner[::-1]] for corner in ORDER])
SIDES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
BOX = [HOLE[list(side)] for side in SIDES]


def body_of(faces, kind: str = "wall"):
    """The body of a volume whose wall has these faces, each an array of its corners."""
    start = np.concatenate([[0], np.cumsum([len(face) for face in faces])])
    patch = Patch("skin", kind, polygons=Polygons(np.concatenate(faces), start))
    block = Block(POINTS, Cells.of_one_type(HEXAHEDRON, BRICKS[KEEP]), point_data={"rho": np.ones(729)})
    return writers.field([block], spacing=0.125, dataset={"patches": [patch]}).body


@pytest.mark.parametrize(
    "faces",
    [
        BOX,
        [HOLE[[side[k] for k in part]] for side in SIDES for part in ((0, 1, 2), (0, 2, 3))],
        BOX[:5],  # open on one side, where it is closed by a fan
        [face[::-1] if k % 2 else face for k, face in enumerate(BOX)],
    ],
    ids=["squares", "triangles", "open", "turned"],
)
def test_a_box_of_any_faces(faces):
    """Expected: the volume of the box, 0.25^3, to 1e-12."""
    body = body_of(faces)
    a, b, c = body.vertices[body.triangles].transpose(1, 0, 2)
    assert abs(np.einsum("nk,nk->n", a, np.cross(b, c)).sum() / 6.0) == pytest.approx(0.25**3, rel=1e-12)


def moebius(count: int = 12) -> list[np.ndarray]:
    angle = 2.0 * np.pi * np.arange(count + 1) / count
    way = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    lean = np.cos(angle / 2)[:, None] * way + np.sin(angle / 2)[:, None] * [0.0, 0.0, 1.0]
    one, other = 0.5 + 0.1 * way + 0.03 * lean, 0.5 + 0.1 * way - 0.03 * lean
    return [np.array([one[k], other[k], other[k + 1], one[k + 1]]) for k in range(count)]


@pytest.mark.parametrize(
    ("faces", "told"),
    [
        ([*BOX, np.array([HOLE[0], HOLE[1], [0.2, 0.2, 0.2]])], "three faces share an edge"),
        (moebius(), "a surface has one side only"),
        ([np.array([[0.5, 0.5, 0.5], *pair]) for pair in (((0.6, 0.5, 0.5), (0.5, 0.6, 0.5)),
                                                          ((0.4, 0.5, 0.5), (0.5, 0.4, 0.5)))], ""),
    ],
    ids=["three", "one side", "no volume"],
)  # fmt: skip
def test_surfaces_that_bound_no_body(faces, told):
    if told:
        with pytest.raises(ReadError, match=f"its walls make no body: {told}"):
            body_of(faces)
    else:
        assert body_of(faces) is None
    assert body_of(moebius(), kind="BCFarfield") is not None  # no wall: the hole of the mesh is the body
