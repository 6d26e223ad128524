"""Half planes of axisymmetric flows in planes of any two coordinates: their axis, their radius, what is refused."""

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow.reading.dataset import HEXAHEDRON, PRISM, PYRAMID, TETRAHEDRON, Block, Cells, Dataset
from aerokernels.flow.reading.density import Reference
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.read import field_of, reading_of


def read(along: int, across: int, radii, frame=None):
    """A flow of density 1 + along / 10 + radius over two of the file's axes, read as axisymmetric."""
    radius, place = np.meshgrid(radii, np.linspace(0.0, 2.0, 6), indexing="ij")
    points = np.zeros((radius.size, 3))
    points[:, along], points[:, across] = place.ravel(), radius.ravel()
    density = 1.0 + 0.1 * place + np.abs(radius)
    block = Block(points, None, (6, len(radii), 1), {"rho": density.ravel()})
    asked = (None, Frame.of(frame), None, Reference(), None, "axisymmetric", None)
    return field_of(reading_of("file", Dataset([block], "x"), *asked))


RADII = np.linspace(0.0, 1.0, 5)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["above", "below"])
@pytest.mark.parametrize(
    ("along", "across", "frame"), [(0, 1, None), (0, 2, None), (2, 1, "-z"), (1, 2, {"flow": "+y"})],
)  # fmt: skip
def test_a_half_plane_of_any_two_axes_is_read(along, across, frame, sign):
    """Set-up: x or, in a plane of y and z, the optical axis that is given as axis; the half above or below it."""
    field = read(along, across, sign * RADII, frame)
    at = np.array([[0.3, 0.4, -1.5], [0.0, 0.25, -0.2]])
    assert field.density_at(at) == pytest.approx([1.0 + 0.15 + 0.5, 1.0 + 0.02 + 0.25])


@pytest.mark.parametrize(
    ("along", "radii", "message"),
    [
        (
            0,
            np.linspace(-1.0, 1.0, 5),
            r"on both sides of the axis of symmetry, from -1 to 1 in the file's unit: give one",
        ),
        (
            2,
            RADII,
            r"its plane is across \[1.0, 0.0, 0.0\], and so does not contain the axis .*: give the optical axis",
        ),
    ],
    ids=["both halves", "no axis"],
)
def test_a_plane_that_is_no_half_plane_of_the_axis_is_refused(along, radii, message):
    """Both were refused as folded meshes, to be repaired."""
    with pytest.raises(flow.ReadError, match=message):
        read(along, 1, radii)


def sector(angle: float, layers: int = 2):
    """A grid between two planes through x, with `layers` planes of points and with points on the axis."""
    turn, radius, place = np.meshgrid(
        np.linspace(-0.5 * angle, 0.5 * angle, layers), RADII, np.linspace(0.0, 2.0, 6), indexing="ij"
    )
    points = np.stack([place, radius * np.cos(turn), radius * np.sin(turn)], axis=-1).reshape(-1, 3)
    return Block(points, None, (6, len(RADII), layers), {"rho": 1.0 + 0.1 * points[:, 0]})


def taken(block, geometry=None):
    asked = (None, Frame(), None, Reference(), None, geometry, None)
    return reading_of("file", Dataset([block], "x"), *asked)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)], ids="xyz")
def test_a_wedge_of_a_flow_of_revolution_is_no_volume(order):
    """Set-up: a sector of 5 degrees, one cell thick, about each axis, whose sides do not agree. Expected: refused.

    It was read as a volume, of which rays crossed the thin sector alone. Requested as a volume, it is one.
    """
    block = sector(np.radians(5.0))
    unlike = block.point_data["rho"] + 1e-3 * (block.points[:, 2] > 0.0)
    turned = Block(block.points[:, order], None, block.shape, {"rho": unlike})
    axis = "xyz"[order.index(0)]
    for asked in (None, "axisymmetric"):
        with pytest.raises(
            flow.ReadError, match=rf"meet in the {axis} axis at 5 degrees: a wedge, .* from side to side"
        ):
            taken(turned, asked)
    assert taken(turned, "volume").geometry == "volume"
    for volume in (sector(np.radians(5.0), 3), sector(np.radians(40.0))):
        assert taken(volume).geometry == "volume"


def solid(kind: str, half: float, order=(0, 1, 2), real=np.float64) -> Block:
    """Cells between two planes at an angle, as meshers make them: those at the axis have lost corners.

    "hexahedra" keep their doubled corners at the axis; "prisms" share these points; "triangles" are cut in two, which
    leaves pyramids and tetrahedra at the axis. Densities are 1 + x / 10 + r at the points and in the cells.
    """
    along, radii = np.linspace(0.0, 2.0, 6), RADII
    place, radius = (own.ravel() for own in np.meshgrid(along, radii, indexing="ij"))
    number = np.arange(place.size).reshape(len(along), len(radii))
    squares = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    layers = [np.stack([place, radius * np.cos(turn), radius * np.sin(turn)], axis=1) for turn in (-half, half)]
    points = np.concatenate(layers)
    upper = np.arange(place.size) + place.size
    if kind != "hexahedra":
        upper[radius == 0.0] = np.flatnonzero(radius == 0.0)
    flat = squares if kind != "triangles" else np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
    types, corners = [], []
    for face in flat:
        above = upper[face]
        apart = above != face
        if apart.all():
            types.append(HEXAHEDRON if len(face) == 4 else PRISM)
            corners.append([*face, *above])
        elif len(face) == 4:  # 0 and 1 are on the axis
            types.append(PRISM)
            corners.append([face[0], face[3], above[3], face[1], face[2], above[2]])
        else:
            on, off = face[~apart], face[apart]
            types.append(PYRAMID if len(off) == 2 else TETRAHEDRON)
            corners.append(
                [off[0], off[1], upper[off[1]], upper[off[0]], *on] if len(off) == 2 else [*on, *off, upper[off[0]]]
            )
    start = np.concatenate([[0], np.cumsum([len(own) for own in corners])])
    cells = Cells(np.array(types, np.uint8), start, np.concatenate(corners))
    means = np.array([np.mean(1.0 + 0.1 * place[own] + radius[own]) for own in flat])
    rho = np.tile(1.0 + 0.1 * place + radius, 2)
    points = points.astype(real).astype(np.float64)
    return Block(points[:, order], cells, None, {"rho": rho}, {"mean": means})


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)], ids="xyz")
@pytest.mark.parametrize("kind", ["hexahedra", "prisms", "triangles", "structured"])
@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_a_wedge_is_read_as_a_flow_of_revolution(kind: str, order, real):
    """Set-up: wedges of 5 degrees with cells of every kind, in either precision, about each axis of the file.

    Expected: the density at radii, exact in the linear flow; the averages of the cells.
    """
    if kind == "structured":
        block = sector(np.radians(5.0))
        points = block.points.astype(real).astype(np.float64)
        radius = np.hypot(block.points[:, 1], block.points[:, 2])
        block = Block(points[:, order], None, block.shape, {"rho": block.point_data["rho"] + radius})
    else:
        block = solid(kind, np.radians(2.5), order, real)
    at = np.array([[0.3, 0.4, -1.5], [0.0, 0.25, -0.2], [0.01, 0.0, -1.9]])
    for asked in (None, "axisymmetric"):
        reading = taken(block, asked)
        assert reading.geometry == "axisymmetric"
        field = field_of(reading)
        expected = 1.0 - 0.1 * at[:, 2] + np.hypot(at[:, 0], at[:, 1])
        assert field.density_at(at) == pytest.approx(expected, rel=3e-7)
        assert "a wedge of 5 degrees about" in field.provenance
    if kind != "structured":
        asked = ("mean", Frame(), None, Reference(), None, None, None)
        cells = field_of(reading_of("file", Dataset([block], "x"), *asked))
        if kind != "triangles":  # which are cut into parts
            middle = cells.mesh.corners.mean(axis=1)
            assert cells.density == pytest.approx(1.0 - 0.1 * middle[:, 1] + middle[:, 0], rel=3e-7)


@pytest.mark.parametrize(("low", "doubtful"), [(0.0, True), (0.01, False), (-1.0, False)])
def test_a_plane_that_begins_at_an_axis_is_doubtful(low: float, doubtful: bool, tmp_path):
    """A file whose y is a radius does not say so: the provenance of a planar flow does, where y begins at 0."""
    x, y = np.linspace(0.0, 1.0, 5), np.linspace(low, 1.0, 6)
    np.savez(tmp_path / "a.npz", x=x, y=y, rho=np.ones((5, 6)))
    said = "it begins at y = 0: if that is an axis of symmetry, give geometry = 'axisymmetric'"
    assert (said in flow.read(tmp_path / "a.npz").provenance) == doubtful
    if doubtful:
        assert said not in flow.read(tmp_path / "a.npz", geometry="axisymmetric").provenance
