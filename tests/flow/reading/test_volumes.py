"""Volumes: uniform grids are kept, meshes of any solid cells are resampled, and the reported error is the true one."""

import numpy as np
import pytest
import vtk_writers
import writers

from aerokernels import flow
from aerokernels.flow.reading.dataset import HEXAHEDRON, POLYHEDRON, PRISM, PYRAMID, TETRAHEDRON, Block, Cells


def linear(points):
    return 1.2 + points @ np.array([0.5, -0.3, 0.8])


def field(block: Block, density: str = "rho", spacing=None, frame=None):
    return writers.field([block], name="test", density=density, spacing=spacing, frame=frame)


def cube(n: int = 6):
    """Points of a skewed grid of n^3 hexahedra in the unit cube, and the corners of its cells."""
    axis = np.linspace(0.0, 1.0, n + 1)
    k, j, i = np.meshgrid(axis, axis, axis, indexing="ij")
    points = np.stack([i + 0.05 * j * (1.0 - i) * i, j, k + 0.0 * i], axis=-1).reshape(-1, 3)
    m = n + 1
    index = np.arange(m**3).reshape(m, m, m)
    corners = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = [index[a : n + a, b : n + b, c : n + c].ravel() for a, b, c in corners]
    return points, np.stack(cells, axis=1)


def split(kind: int, corners: np.ndarray, points: np.ndarray):
    """Hexahedra as cells of another type that fill the same room; new points at the end."""
    if kind == HEXAHEDRON:
        return points, corners
    if kind == PRISM:
        return points, np.concatenate([corners[:, [0, 1, 2, 4, 5, 6]], corners[:, [0, 2, 3, 4, 6, 7]]])
    middle = len(points) + np.arange(len(corners))
    points = np.concatenate([points, points[corners].mean(axis=1)])
    faces = [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    quads = np.concatenate([np.column_stack([corners[:, face], middle]) for face in faces])
    if kind == PYRAMID:
        return points, quads
    # One diagonal for both cells that share a face: the one from its lowest corner.
    turn = np.argmin(quads[:, :4], axis=1)
    turned = quads[np.arange(len(quads))[:, None], (turn[:, None] + np.arange(4)) % 4]
    apex = quads[:, 4]
    return points, np.concatenate(
        [np.column_stack([turned[:, [0, 1, 2]], apex]), np.column_stack([turned[:, [0, 2, 3]], apex])]
    )


@pytest.mark.parametrize("kind", [HEXAHEDRON, PRISM, PYRAMID, TETRAHEDRON])
def test_linear_density_at_points_is_kept_exactly(kind):
    """Set-up: a linear density at the points of cells of one type. Expected: the same everywhere, to rounding."""
    points, corners = split(kind, *cube()[::-1])
    found = field(Block(points, Cells.of_one_type(kind, corners), point_data={"rho": linear(points)}), spacing=0.07)
    assert found.geometry == "volume"
    inner = np.random.default_rng(3).uniform(0.0, 1.0, (500, 3))
    assert np.abs(found.density_at(inner) - linear(inner)).max() < 1e-12
    assert found.resampling.outside_share == 0.0
    assert found.resampling.density_max < 1e-12


def foam_case(case, points, corners, is_wall=lambda middle: np.zeros(len(middle), bool)):
    """An OpenFOAM case of hexahedra whose averages are those of `linear`; boundary faces are walls or "far"."""
    mesh = case / "constant" / "polyMesh"
    mesh.mkdir(parents=True)
    faces: dict[tuple, list] = {}
    table = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    for cell, own in enumerate(corners):
        for face in table:
            round_it = [int(own[k]) for k in face]
            faces.setdefault(tuple(sorted(round_it)), []).append((cell, round_it))
    wall = {
        key: len(pair) == 1 and bool(is_wall(points[list(key)].mean(axis=0)[None])[0]) for key, pair in faces.items()
    }
    ordered = [
        faces[key]
        for key in sorted(faces, key=lambda k: (len(faces[k]) == 1, wall[k], faces[k][0][0], faces[k][-1][0]))
    ]
    owner = [pair[0][0] for pair in ordered]
    neighbour = [pair[1][0] for pair in ordered if len(pair) > 1]
    rows = "\n".join(f"4({' '.join(map(str, pair[0][1]))})" for pair in ordered)
    head = writers.foam_header
    (mesh / "points").write_bytes(head("vectorField", "points", False) + writers.foam_list(points, False))
    (mesh / "faces").write_bytes(head("faceList", "faces", False) + f"{len(ordered)}\n(\n{rows}\n)\n".encode())
    for name, values in (("owner", owner), ("neighbour", neighbour)):
        (mesh / name).write_bytes(head("labelList", name, False) + writers.foam_list(np.array(values), False))
    walls = sum(wall.values())
    count = len(ordered) - len(neighbour) - walls
    patch = f"2\n(\n    far {{ type patch; nFaces {count}; startFace {len(neighbour)}; }}\n"
    patch += f"    body {{ type wall; nFaces {walls}; startFace {len(neighbour) + count}; }}\n)\n"
    (mesh / "boundary").write_bytes(head("polyBoundaryMesh", "boundary", False) + patch.encode())
    (case / "1").mkdir()
    # Averages over skewed cells: the density at the centroid, which for the linear one is exact.
    from aerokernels.flow.reading.volumes.solids import solid_chunks

    block = Block(points, Cells.of_one_type(HEXAHEDRON, corners))
    middle = np.concatenate([made().middle.T for made in solid_chunks(block, np.ascontiguousarray(points.T))])
    body = b"internalField nonuniform List<scalar>" + writers.foam_list(linear(middle), False) + b";\n"
    (case / "1" / "rho").write_bytes(head("volScalarField", "rho", False) + body)
    return case


def test_polyhedra_of_openfoam(tmp_path):
    """Set-up: an OpenFOAM case of 8^3 cells without wedge or empty patches. Expected: a linear density is kept."""
    n = 8
    case = foam_case(tmp_path / "case", *cube(n))
    found = flow.read(case, spacing=1.0 / 23.0)
    inner = np.random.default_rng(5).uniform(0.0, 1.0, (400, 3))
    assert np.abs(found.density_at(inner) - linear(inner)).max() < 1e-12
    assert "at walls" not in found.provenance  # it has none
    assert POLYHEDRON in set(np.unique(flow.reading.formats.load(case, None, {}).blocks[0].cells.types))


def test_a_body_that_goes_on_beyond_the_field(tmp_path):
    """Set-up: OpenFOAM's wall patch around a square rod that ends with the field, 10^3 cells; z = -x of the file.

    Expected: the rod, closed flat where the field ends; a ray that comes along z ends on its face at z = 0.5 - 1, one
    that starts inside begins on it. Named patches bound nothing else, and unknown ones are refused.
    """
    points, corners = cube(10)
    points[:, 0] += -0.05 * points[:, 1] * (1.0 - points[:, 0]) * points[:, 0]
    middle = points[corners].mean(axis=1)

    def rod(p):
        return (np.abs(p[:, 1:] - 0.5) < 0.2001).all(axis=1) & (p[:, 0] > 0.4999)

    def is_wall(p):
        return rod(p) & (p[:, 0] < 0.9999)

    case = foam_case(tmp_path / "case", points, corners[~rod(middle)], is_wall)
    found = flow.read(case, frame={"optical": "-x"}, spacing=0.05)
    low, high = found.body.box
    assert np.allclose(low, [0.3, 0.3, -1.0], atol=0.51) and np.isclose(high[2], -0.5, atol=1e-9)
    assert np.isclose(np.prod(high - low), 0.4 * 0.4 * 0.5, rtol=1e-3)
    centre = 0.5 * (low + high)
    ahead = found.body.crossings([centre + np.array([0.0, 0.0, 1.0])], [[0.0, 0.0, -1.0]])
    assert np.allclose(ahead, [[0.75, 1.25]], atol=1e-3)
    assert "a body of" in found.provenance
    assert "the solver's values at walls (body) are not used" in found.provenance
    with pytest.raises(flow.ReadError, match="no patch 'wings'"):
        flow.read(case, walls=["wings"], spacing=0.1)


def test_uniform_grid_is_kept_and_turned_by_the_frame(tmp_path):
    """Set-up: a .vti volume, rho + z. Expected: no resampling; with optical = -x each node lies where it should."""
    pytest.importorskip("vtkmodules")
    path = vtk_writers.write_vtk(tmp_path / "a.vti", vtk_writers.vtk_even(three=True))
    plain, turned = flow.read(path), flow.read(path, frame={"optical": "-x"}, length_unit="cm")
    at = np.array([[0.03, 0.03, 0.02], [0.06, 0.012, 0.01]])
    exact = writers.rho(at[:, 0], at[:, 1]) + at[:, 2]
    assert plain.density_at(at) == pytest.approx(exact, rel=1e-14)
    # z = -x, y = y, so x = z of the file; lengths in cm
    moved = 0.01 * np.stack([at[:, 2], at[:, 1], -at[:, 0]], axis=1)
    assert turned.density_at(moved) == pytest.approx(exact, rel=1e-12)
    assert turned.resampling is None


def test_a_body_in_a_volume_is_carried_on_into():
    """Set-up: a cube of hexahedra without its middle ones. Expected: some nodes are outside, no jump to ambient."""
    points, corners = cube(8)
    middle = points[corners].mean(axis=1)
    keep = np.abs(middle - 0.5).max(axis=1) > 0.2
    found = field(
        Block(points, Cells.of_one_type(HEXAHEDRON, corners[keep]), cell_data={"rho": 1.0 + 0.0 * middle[keep, 0]})
    )
    assert 0.01 < found.resampling.outside_share < 0.2
    assert np.ptp(found.density) < 1e-12
    # The hole is the body: what its cells' faces bound, wherever the nodes lie.
    low, high = (reduce(points[corners[~keep]].reshape(-1, 3)) for reduce in (lambda p: p.min(0), lambda p: p.max(0)))
    assert np.array_equal(found.body.box, [low, high])
    inside = np.random.default_rng(2).uniform(low + 0.02, high - 0.02, (200, 3))
    assert found.body.contains(inside).all() and np.isnan(found.density_at(inside)).all()
    assert not found.body.contains(middle[keep]).any()
    assert found.index_field(905e-9).body is found.body


@pytest.mark.parametrize("fault", ["inside out", "same place"])
def test_broken_volumes_are_refused(fault):
    points, corners = cube(4)
    if fault == "inside out":
        corners[7] = corners[7][[4, 5, 6, 7, 0, 1, 2, 3]]
    else:
        points = np.concatenate([points, points[:1]])
    block = Block(points, Cells.of_one_type(HEXAHEDRON, corners), cell_data={"rho": np.ones(len(corners))})
    with pytest.raises(flow.ReadError, match=fault):
        field(block)
