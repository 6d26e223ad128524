"""Half planes of axisymmetric flows in planes of any two coordinates: their axis, their radius, what is refused."""

import numpy as np
import pytest
import writers

from aerokernels import flow
from aerokernels.flow.reading.dataset import Block


def read(along: int, across: int, radii, frame=None):
    """A flow of density 1 + along / 10 + radius over two of the file's axes, read as axisymmetric."""
    radius, place = np.meshgrid(radii, np.linspace(0.0, 2.0, 6), indexing="ij")
    points = np.zeros((radius.size, 3))
    points[:, along], points[:, across] = place.ravel(), radius.ravel()
    density = 1.0 + 0.1 * place + np.abs(radius)
    block = Block(points, None, (6, len(radii), 1), {"rho": density.ravel()})
    return writers.field([block], frame=frame, geometry="axisymmetric")


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
            writers.field([turned], geometry=asked)
    assert writers.field([turned], geometry="volume").geometry == "volume"
    for volume in (sector(np.radians(5.0), 3), sector(np.radians(40.0))):
        assert writers.field([volume]).geometry == "volume"


@pytest.mark.parametrize(
    ("order", "real"), [((0, 1, 2), np.float64), ((2, 0, 1), np.float32), ((1, 2, 0), np.float64)], ids="xyz"
)
def test_a_wedge_is_read_as_a_flow_of_revolution(order, real):
    """Set-up: wedges of 5 degrees in either precision about each axis of the file. Expected: the density at radii."""
    block = sector(np.radians(5.0))
    points = block.points.astype(real).astype(np.float64)
    radius = np.hypot(block.points[:, 1], block.points[:, 2])
    block = Block(points[:, order], None, block.shape, {"rho": block.point_data["rho"] + radius})
    at = np.array([[0.3, 0.4, -1.5], [0.0, 0.25, -0.2], [0.01, 0.0, -1.9]])
    for geometry in (None, "axisymmetric"):
        field = writers.field([block], geometry=geometry)
        assert field.geometry == "axisymmetric" and "a wedge of 5 degrees about" in field.provenance
        expected = 1.0 - 0.1 * at[:, 2] + np.hypot(at[:, 0], at[:, 1])
        assert field.density_at(at) == pytest.approx(expected, rel=3e-7)
