"""Where the known air ends, exactly: constant air in a box or a mesh, rays of all kinds, and the rim of a mesh."""

import numpy as np
import pytest

from aerokernels import ArcLength, IndexField, Plane, QuadMesh, RayBundle
from aerokernels.medium import Body
from aerokernels.tracing.error_budget import known_air
from aerokernels.tracing.error_budget.known_air import BESIDE, KnownAir, face_strengths, may_be_lost, may_bend
from aerokernels.tracing.error_budget.mesh_rim import mesh_crossings, mesh_rim, rim_contrast
from aerokernels.tracing.error_budget.tails import extent
from aerokernels.tracing.lines import SIDE, box_size, box_span

CONTRAST = 3e-4
LOW, HIGH, RADIUS = np.array([-1.0, -1.5, 1.0]), np.array([0.75, 2.0, 4.5]), 1.7
GEOMETRIES = ("volume", "planar", "axisymmetric")


def field_of(geometry: str, value=lambda *places: CONTRAST + 0.0 * places[0], counts=(8, 8, 15)) -> IndexField:
    axes = [0, 1, 2] if geometry == "volume" else [1, 2]
    low, high = LOW.copy(), HIGH.copy()
    if geometry == "axisymmetric":
        low[1], high[1] = 0.0, RADIUS
    nodes = [np.linspace(low[k], high[k], counts[k]) for k in axes]
    samples = value(*np.meshgrid(*nodes, indexing="ij"))
    return IndexField.from_samples(
        samples, origin=low[axes], spacing=[one[1] - one[0] for one in nodes], geometry=geometry
    )


def rays_around(count: int = 200) -> RayBundle:
    rng = np.random.default_rng(101)
    start = rng.uniform(-3.0, 6.0, (count, 3))
    way = rng.uniform(LOW - 0.8, HIGH + 0.8, (count, 3)) - start
    start[::9], way[::9] = start[::9] + 12.0, 1.0  # far away, and looking away
    return RayBundle(start, way)


@pytest.mark.parametrize("until", [None, ArcLength(4.1), Plane((0.2, 0.1, 3.7), (0.2, -0.5, 1.0))])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_constant_air_goes_on_for_the_boxs_extent(geometry: str, until):
    """Rays lose c times the way ahead of the entry and behind the exit, up to the stop, each at most the extent.

    A ray that misses the box, or stops ahead of it, loses c times the lesser of extent and stop where it comes nearer
    than the box is large. The face is that of the greater of both losses.
    """
    field, rays = field_of(geometry), rays_around()
    lost, face = may_be_lost(field, rays, until, 1e-3)
    span = box_span(field, rays.position, rays.direction)
    whole = extent(field, rays.direction)
    low, high = (np.asarray(one) for one in field.box)
    kinds = set()
    for row in range(rays.ray_count):
        start, way = rays.position[row], rays.direction[row]
        stop = np.inf
        if isinstance(until, ArcLength):
            stop = until.length
        elif until is not None:
            stop = (until.point - start) @ until.normal / (way @ until.normal)
            stop = stop if stop >= 0.0 else np.inf
        enter, leave = span.enter[row], span.leave[row]
        if not span.meets[row] or (stop <= enter and enter > 0.0):
            t = np.linspace(0.0, min(stop, 30.0), 3001)
            points = start + t[:, None] * way
            off = np.maximum(np.maximum(low - points, points - high), 0.0)
            if geometry == "axisymmetric":
                off = np.c_[np.maximum(np.hypot(points[:, 0], points[:, 1]) - RADIUS, 0.0), off[:, 2]]
            near = np.linalg.norm(off, axis=1).min() / box_size(field)
            if abs(near - 1.0) > 0.02:
                expected = CONTRAST * min(whole[row], stop) if near < 1.0 else 0.0
                assert lost[row] == pytest.approx(expected, rel=1e-9)
                kinds.add("beside" if near < 1.0 else "far")
            assert face[row] == BESIDE
            continue
        before = min(enter, whole[row]) if span.entry_face[row] >= 0 else 0.0
        behind = min(stop - leave, whole[row]) if stop > leave + 1e-6 * box_size(field) else 0.0
        assert lost[row] == pytest.approx(CONTRAST * (before + behind), rel=1e-9, abs=1e-18)
        expected = span.entry_face[row] if before >= behind else span.exit_face[row]
        assert face[row] == (expected if before + behind > 0.0 else BESIDE)
        kinds.add(("enters", "starts inside")[int(enter == 0.0)] + (" and leaves" if behind else ""))
    assert len(kinds) >= 4
    np.testing.assert_array_equal(KnownAir(field, rays, until, 1e-3).lost(), lost)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_strengths_of_faces(geometry: str):
    """The greatest |contrast| of the two outermost layers at each face, 0 at faces that the geometry has not."""
    rng = np.random.default_rng(102)
    field = field_of(geometry, lambda *places: CONTRAST * rng.normal(size=places[0].shape) * (1.0 + places[-1]))
    samples, expected = np.abs(field.samples.samples), np.zeros(7)
    for axis in range(samples.ndim):
        face = 2 * (axis + 3 - samples.ndim)
        expected[face : face + 2] = samples.take([0, 1], axis).max(), samples.take([-1, -2], axis).max()
    if geometry == "axisymmetric":
        expected[2], expected[SIDE] = 0.0, expected[3]
        expected[3] = 0.0
    np.testing.assert_array_equal(face_strengths(field), expected)
    assert (expected > 0.0).sum() == {"volume": 6, "planar": 4, "axisymmetric": 3}[geometry]
    still = field_of(geometry, lambda *places: 0.0 * places[0])
    lost, face = may_be_lost(still, rays_around(), None, 1e-3)
    assert not lost.any() and (face == BESIDE).all()
    weak = field_of(geometry, lambda *places: 1e-12 + 0.0 * places[0])
    assert not may_be_lost(weak, rays_around(), None, 1.0)[0].any()  # a tenth of 1e-9 m is the least that is looked at
    assert may_be_lost(weak, rays_around(), None, 1e-13)[0].any()


def test_traced_ends_take_the_place_of_straight_lines():
    """A ray that ended 1 m outside in y, flying along y: it left by that face, straight back from there.

    One that ended inside has lost what it missed ahead only; without a stop an end on the face has no end.
    """
    field = field_of("volume")
    rays = RayBundle(np.tile([0.1, 0.2, 0.5], (3, 1)), np.tile([0.0, 0.0, 1.0], (3, 1)))
    ends = (
        np.array([[0.1, 3.0, 3.0], [0.1, 0.2, 4.0], [0.1, 0.2, 5.1]]),
        np.array([[0.0, 1, 0], [0.0, 0, 1], [0, 0, 1.0]]),
    )
    lost, face = may_be_lost(field, rays, ArcLength(6.0), 1e-3, ends)
    margin = 1e-6 * box_size(field)
    assert lost == pytest.approx(CONTRAST * np.array([0.5 + 1.0, 0.5, 0.5 + 0.6]), rel=1e-9)
    assert face.tolist() == [3, 4, 5] and margin < 1e-5
    at_face = np.array([[0.1, 2.0, 3.0], [0.1, 0.2, 4.5], [0.1, 0.2, 4.5]]), ends[1]
    lost, face = may_be_lost(field, rays, None, 1e-3, at_face)
    assert lost == pytest.approx(CONTRAST * (0.5 + np.array([3.5, 3.5, 3.5])), rel=1e-9)
    assert face.tolist() == [3, 5, 5]


def test_fields_that_may_bend_rays_by_a_cell():
    """Half the greatest turn times the size over a cell: a slope of 0.1 / m does, one of 1e-6 and a mesh do not."""
    bends = [may_bend(field_of("planar", lambda y, z, g=g: g * y)) for g in (0.1, 1e-6)]
    y, z = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 4), indexing="ij")
    assert bends == [True, False] and not may_bend(IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), 0.5 * y))


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_nearest_points_of_a_box(geometry: str):
    """Against the nearest of many points of the box."""
    field, rng = field_of(geometry), np.random.default_rng(103)
    points = rng.uniform(-4.0, 6.0, (60, 3))
    found = known_air._into_box(field, points)
    if geometry == "axisymmetric":
        radius, angle = RADIUS * np.sqrt(rng.uniform(0, 1, 40000)), rng.uniform(0, 2 * np.pi, 40000)
        some = np.c_[radius * np.cos(angle), radius * np.sin(angle), rng.uniform(1.0, 4.5, 40000)]
        assert (np.hypot(found[:, 0], found[:, 1]) <= RADIUS * (1 + 1e-12)).all()
    else:
        some = rng.uniform(LOW, HIGH, (40000, 3))
        if geometry == "planar":
            assert (found[:, 0] == points[:, 0]).all()
            some[:, 0], points[:, 0], found[:, 0] = 0.0, 0.0, 0.0
    distance = np.linalg.norm(found - points, axis=1)
    brute = np.array([np.linalg.norm(some - one, axis=1).min() for one in points])
    assert (distance <= brute + 1e-12).all() and (brute - distance).max() < 0.3
    assert ((found >= LOW - 1e-12) & (found <= HIGH + 1e-12))[:, 2].all()
    node = known_air._roughly(field_of(geometry, lambda *places: places[-1]), found)
    nodes = np.linspace(1.0, 4.5, 15)
    np.testing.assert_allclose(node, nodes[np.abs(found[:, 2, None] - nodes).argmin(axis=1)], rtol=1e-12)


def test_rays_along_a_face_take_the_strongest_air():
    """A ray along z beside the box: the greatest of 16 places over twice the size; the length by their mean."""
    field = field_of("volume", lambda x, y, z: CONTRAST * np.exp(-(((z - 2.0) / 0.4) ** 2)), (8, 8, 141))
    position, direction = np.array([[0.0, 2.4, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    size, along = box_size(field), 1.5
    found, length = known_air._strongest(
        field, position, direction, np.array([9.0]), np.array([along]), np.array([3.5])
    )
    begin = max(along - size, 0.0)
    step = (min(along + size, 9.0) - begin) / 16
    places = begin + (np.arange(16) + 0.5) * step
    beside = (places >= 1.0) & (places <= 4.5)
    nodes = np.linspace(1.0, 4.5, 141)
    values = CONTRAST * np.exp(-(((nodes[np.abs(places[:, None] - nodes).argmin(axis=1)] - 2.0) / 0.4) ** 2))
    values = np.where(beside, values, 0.0)
    # Places ahead of the box are nearer to it than 0.4 m and a cell only if they are within that.
    near = np.hypot(0.4, np.maximum(np.maximum(1.0 - places, places - 4.5), 0.0)) <= 0.4 + 0.025
    values = np.where(near, values, 0.0)
    assert found[0] == pytest.approx(places[values.argmax()], rel=1e-12)
    assert length[0] == pytest.approx(3.5 * values.sum() / (near.sum() * values.max()), rel=1e-9)
    across = np.array([[0.0, 1.0, 0.0]])  # one that only passes keeps its place and length
    kept = known_air._strongest(
        field, np.array([[0.0, -3.0, 0.5]]), across, np.array([9.0]), np.array([3.2]), np.array([3.5])
    )
    assert [one[0] for one in kept][1] <= 3.5


# --- the rim of a mesh -----------------------------------------------------------------------------------------------


def ring(geometry: str = "planar", body: Body | None = None, contrast: float = CONTRAST) -> IndexField:
    """Skewed cells from y = 0 to 1.2 and z = 1 to 2.5."""
    y, z = np.meshgrid(np.linspace(0.0, 1.2, 5), np.linspace(1.0, 2.5, 6), indexing="ij")
    z = z + 0.3 * y
    values = contrast * (1.0 + y + 2.0 * z)
    return IndexField.from_mesh(QuadMesh.structured(y, z, geometry), values, body=body)


def sides_of(field: IndexField) -> list[tuple[int, int, int]]:
    """(cell, first, last vertex) of edges that belong to one cell."""
    cells = field.mesh.cells
    edges = {}
    for number, cell in enumerate(cells.tolist()):
        for k in range(4):
            edges.setdefault(frozenset((cell[k], cell[(k + 1) % 4])), []).append((number, cell[k], cell[(k + 1) % 4]))
    return [found[0] for found in edges.values() if len(found) == 1]


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_the_rim_is_the_edges_of_one_cell(geometry: str):
    """But not those on the axis; strengths are the greater of both ends, sizes those of the cells."""
    field = ring(geometry)
    rim, mesh = mesh_rim(field), field.mesh
    expected = set()
    for number, a, b in sides_of(field):
        (p, q), values = mesh.vertices[[a, b]], np.abs(field.samples.values[[a, b]])
        if geometry == "axisymmetric" and p[0] == q[0] == 0.0:
            continue
        expected.add((*p, *q, values.max(), mesh.cell_size[number]))
    found = {tuple(row) for row in np.c_[rim.start, rim.end, rim.strength, rim.cell]}
    assert found == expected and len(found) == (18 if geometry == "planar" else 13)
    part = rim.part(float(np.median(rim.strength)))
    kept = rim.strength > np.median(rim.strength)
    np.testing.assert_array_equal(part.start, rim.start[kept])
    np.testing.assert_array_equal(part.cell, rim.cell[kept])
    places = 0.5 * (rim.start + rim.end)
    point = np.c_[0.0 * places[:, :1], places]
    np.testing.assert_array_equal(rim_contrast(field, point), rim.strength)
    assert rim_contrast(field, np.array([[0.0, 9.0, 9.0]])).tolist() == [0.0]
    assert face_strengths(field).tolist() == [0.0] * 6 + [rim.strength.max()]


def test_edges_on_walls_seams_and_in_still_air_are_no_rim():
    """Those along a body's wall; both sides of a cut; those whose ends have no contrast."""
    wall = np.array([[0.0, 1.0], [0.6, 1.18], [0.6, 0.5], [0.0, 0.5]])  # along the lower side up to y = 0.6
    rim = mesh_rim(ring(body=Body(wall, "planar")))
    free = {tuple(row) for row in mesh_rim(ring()).start} - {tuple(row) for row in rim.start}
    assert free == {(0.3, 1.09), (0.6, 1.18)} or free == {(0.0, 1.0), (0.3, 1.09)}
    y, z = np.meshgrid([0.0, 1.0], np.linspace(0.0, 2.0 * np.pi, 9), indexing="ij")
    shell = 1.0 + y
    mesh = QuadMesh.structured(shell * np.cos(z) + 3.0, shell * np.sin(z) + 3.0, "planar")
    closed = mesh_rim(IndexField.from_mesh(mesh, np.ones(18) * CONTRAST))
    assert len(closed.start) == 16  # eight edges inside and outside each, none at the seam
    values = np.zeros((5, 6))
    values[0, 0], values[2, 3] = -2.0 * CONTRAST, CONTRAST
    y, z = np.meshgrid(np.arange(5.0), np.arange(6.0), indexing="ij")
    weak = mesh_rim(IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), values))
    assert sorted(map(tuple, np.c_[weak.start, weak.end].tolist())) == [(0, 0, 1, 0), (0, 1, 0, 0)]
    assert weak.strength.tolist() == [2.0 * CONTRAST] * 2


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_rays_cross_the_rim_where_samples_say(geometry: str):
    """Changes between mesh and none along lines sampled every 2 mm: place, way into the mesh, path outside."""
    field = ring(geometry)
    rng = np.random.default_rng(104)
    start = rng.uniform([-1.5, -2.0, -0.5], [1.5, 2.0, 4.0], (80, 3))
    way = rng.uniform([-0.6, 0.0, 1.0], [0.6, 1.0, 2.7], (80, 3)) - start
    way /= np.linalg.norm(way, axis=1)[:, None]
    stop = rng.uniform(1.0, 6.0, 80)
    found = mesh_crossings(field, start, way, stop, 0.0)
    total = 0
    for row in range(80):
        t = np.arange(0.0, stop[row], 2e-3)
        inside = field.mesh.locate(field.local_coordinates(start[row] + t[:, None] * way[row])) >= 0
        change = np.flatnonzero(inside[1:] != inside[:-1])
        some = np.flatnonzero(found.ray == row)
        order = np.argsort((found.point[some] - start[row]) @ way[row])
        some = some[order]
        if len(some) != len(change):  # a corner may be cut within one sample
            assert len(some) % 2 == len(change) % 2
            continue
        for k, at in zip(some, change, strict=True):
            distance = (found.point[k] - start[row]) @ way[row]
            assert t[at] - 1e-9 <= distance <= t[at + 1] + 1e-9
            np.testing.assert_allclose(found.point[k], start[row] + distance * way[row], atol=1e-12)
            leaves = inside[at]
            np.testing.assert_array_equal(found.inward[k], -way[row] if leaves else way[row])
            assert found.path[k] == pytest.approx(stop[row] - distance if leaves else distance, rel=1e-9)
            total += 1
    assert total > 60
    strengths = dict(zip(map(tuple, np.c_[mesh_rim(field).strength]), mesh_rim(field).cell, strict=True))
    assert all(strengths[(one,)] == cell for one, cell in zip(found.contrast, found.cell, strict=True))
    weakest = float(np.median(found.contrast))
    few = mesh_crossings(field, start, way, stop, weakest)
    assert len(few.ray) == (found.contrast > weakest).sum()


def test_a_mesh_of_constant_air_loses_what_lies_beyond_its_rim():
    """As for boxes: c times the way before and behind, at most the extent of the mesh's box."""
    y, z = np.meshgrid(np.linspace(-1.5, 2.0, 5), np.linspace(1.0, 4.5, 6), indexing="ij")
    field = IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), np.full(30, CONTRAST))
    rays = rays_around(80)
    lost, _ = may_be_lost(field, rays, ArcLength(7.0), 1e-3)
    span, whole = box_span(field, rays.position, rays.direction), extent(field, rays.direction)
    for row in np.flatnonzero(span.meets & (span.enter < 7.0)):
        before = min(span.enter[row], whole[row])
        behind = min(max(7.0 - span.leave[row], 0.0), whole[row])
        assert lost[row] == pytest.approx(CONTRAST * (before + behind), rel=1e-6, abs=1e-12)
