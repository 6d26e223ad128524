"""Which cell of a mesh holds a point: neighbours, and that the walk from a remembered cell finds what the bins find."""

import functools

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.medium import IndexField, QuadMesh
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from tests.random_fields import mesh_field
from tests.slow import first_of

from ..backends import ENGINES, WAVE, on
from ..stepped_reference import trace_in_steps

# --- neighbours ------------------------------------------------------------------------------------------------------


def sheet(rows: int = 7, columns: int = 9) -> QuadMesh:
    """A structured mesh of 7 x 9 cells, a little askew."""
    y, z = np.meshgrid(np.arange(rows + 1.0), np.arange(columns + 1.0), indexing="ij")
    return QuadMesh.structured(y + 0.1 * np.sin(z), z + 0.1 * np.cos(y))


def shuffled(mesh: QuadMesh, seed: int = 2) -> QuadMesh:
    """The same mesh, unstructured: cells and vertices in any order, cells beginning at any corner."""
    rng = np.random.default_rng(seed)
    place = rng.permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[place] = mesh.vertices
    cells = place[mesh.cells][rng.permutation(len(mesh.cells))]
    turns = (np.arange(4) + rng.integers(0, 4, (len(cells), 1))) % 4
    return QuadMesh(vertices, np.take_along_axis(cells, turns, axis=1))


def with_gap() -> QuadMesh:
    """The sheet without two of its inner cells, which do not touch."""
    mesh = sheet()
    return QuadMesh(mesh.vertices, np.delete(mesh.cells, [2 * 9 + 3, 4 * 9 + 6], axis=0))


@pytest.mark.parametrize(
    ("mesh", "boundary"),
    [
        (sheet(), 2 * (7 + 9)),
        (shuffled(sheet()), 2 * (7 + 9)),
        (with_gap(), 2 * (7 + 9) + 2 * 4),
        (shuffled(with_gap()), 2 * (7 + 9) + 2 * 4),
        (sheet(1, 1), 4),
        (flow.shipped("mach3").index_field().mesh, 2 * (250 + 80)),
    ],
    ids=["structured", "shuffled", "gap", "shuffled-gap", "one-cell", "mach3"],
)
def test_neighbours_are_mutual_and_share_an_edge(mesh, boundary):
    """-1 at exactly the boundary's edges; the cell behind edge k holds its two vertices, and has this one behind it."""
    behind = mesh.neighbors
    assert behind.shape == mesh.cells.shape
    assert (behind == -1).sum() == boundary and behind.min() >= -1 and behind.max() < len(mesh.cells)
    cell, edge = np.nonzero(behind >= 0)
    other = behind[cell, edge]
    assert (other != cell).all()
    ends = np.stack([mesh.cells[cell, edge], mesh.cells[cell, (edge + 1) % 4]], axis=1)
    assert (mesh.cells[other][:, None, :] == ends[:, :, None]).any(axis=2).all()
    back_edge = np.argmax(behind[other] == cell[:, None], axis=1)
    assert (behind[other, back_edge] == cell).all()
    # Both cells run round counter-clockwise: the shared edge the one way in one and the other way in the other.
    back = np.stack([mesh.cells[other, back_edge], mesh.cells[other, (back_edge + 1) % 4]], axis=1)
    assert np.array_equal(back, ends[:, ::-1])


def test_no_neighbour_across_a_seam():
    """A ring whose first and last row of vertices coincide: the bins alone lead across."""
    mesh = ring().mesh
    rows, columns = mesh.shape[0] - 1, mesh.shape[1] - 1
    assert (mesh.neighbors == -1).sum() == 2 * (rows + columns)
    seam = mesh.neighbors.reshape(rows, columns, 4)
    assert ((seam[0] == -1).sum(axis=1) >= 1).all() and ((seam[-1] == -1).sum(axis=1) >= 1).all()


# --- the walk and the bins -------------------------------------------------------------------------------------------


@functools.cache
def ring() -> IndexField:
    """An O-mesh of 48 x 12 cells between circles of 0.4 and 1 mm about (0, 1.2) mm, closed in a seam along +y.

    Its box has corners outside the mesh, and its middle is a hole: a ray across leaves the mesh and comes back.
    """
    angle, radius = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 49), np.linspace(0.4e-3, 1e-3, 13), indexing="ij")
    angle[-1] = angle[0]  # the seam's vertices lie in the very same places
    y, z = radius * np.cos(angle), 1.2e-3 + radius * np.sin(angle)
    contrast = 3e-4 * (1.0 + 0.5 * np.cos(3.0 * angle)) * np.sin(np.pi * (radius - 0.4e-3) / 0.6e-3)
    return IndexField.from_mesh(QuadMesh.structured(y, z), contrast, ambient_index=1.0001)


@functools.cache
def gap() -> IndexField:
    """The wavy mesh, shuffled, with every ninth cell missing: index jumps at the gaps' edges."""
    whole = mesh_field()
    cells = whole.mesh.cells
    row, column = np.divmod(np.arange(len(cells)), whole.mesh.shape[1] - 1)
    keep = ~((row % 3 == 1) & (column % 3 == 1))
    mesh = shuffled(QuadMesh(whole.mesh.vertices, cells[keep]))
    order = np.random.default_rng(2).permutation(len(whole.mesh.vertices))
    contrast = np.empty(len(order))
    contrast[order] = whole.samples.values
    return IndexField.from_mesh(mesh, contrast, ambient_index=whole.ambient_index)


@functools.cache
def mach3() -> IndexField:
    return flow.shipped("mach3").index_field()


def across(count: int, middle: float, half: float, z: float, seed: int) -> RayBundle:
    """Rays near the plane x = 0 from height z, within `half` of y = middle and 0.05 rad of the z axis."""
    rng = np.random.default_rng(seed)
    position = np.c_[rng.uniform(-1e-4, 1e-4, count), middle + rng.uniform(-half, half, count), np.full(count, z)]
    return RayBundle(position, np.c_[rng.normal(0.0, 0.02, (count, 2)), np.ones(count)])


# Field, rays' middle and half width in y, their start in z, the stop's z and the step [m].
SCENES = {
    "ring-from-outside": (ring, 0.0, 0.95e-3, -0.1e-3, 3e-3, 3.1e-5),
    "ring-from-its-hole": (ring, 0.0, 0.2e-3, 1.2e-3, 3e-3, 3.1e-5),
    "ring-from-a-corner-of-the-box": (ring, 0.9e-3, 0.05e-3, 0.25e-3, 3e-3, 3.1e-5),
    "gaps": (gap, 0.0, 1e-3, -0.1e-3, 6e-3, 3.7e-5),
    "mach3": (mach3, 0.0125, 0.002, -0.02, 0.03, 2.3e-4),
}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scene", first_of(SCENES, 4))
def test_the_walk_finds_what_the_reference_finds(scene, engine):
    """float64, the same fixed steps as the reference, which asks the bins anew for every point.

    Rays pass beside the body. Error sources: rounding, and the last step, which the kernel ends by the tangent: where
    it leaves the mesh and its slope jumps to nothing, 1e-11 rad. Tolerance: 1e-7 wave and 1e-10 rad.
    """
    make, middle, half, start, stop, step = SCENES[scene]
    backend, field, rays = on(engine), make(), across(3, middle, half, start, 4)
    settings = {"until": Plane((0, 0, stop), (0, 0, 1)), "method": "fixed", "step": step, "precision": "float64"}
    expected = of_reference(scene)
    result = trace(field, rays, **settings, **backend)
    assert np.array_equal(result.status, expected.status) and expected.ok.all()
    assert np.array_equal(result.step_count, expected.step_count) and expected.step_count.min() > 20
    assert np.abs(result.opd - expected.opd).max() < 1e-7 * WAVE and np.abs(expected.opd).min() > 1e-3 * WAVE
    assert np.abs(result.direction - expected.direction).max() < 1e-10


@functools.cache
def of_reference(scene: str):
    make, middle, half, start, stop, step = SCENES[scene]
    return trace_in_steps(make(), across(3, middle, half, start, 4), until=Plane((0, 0, stop), (0, 0, 1)), step=step)


def without_neighbours(field: IndexField) -> IndexField:
    """The same field on a mesh that knows no neighbours: every walk ends at the first edge, the bins do it all."""
    mesh = field.mesh
    lonely = QuadMesh(mesh.vertices, mesh.cells, mesh.geometry, mesh.shape)
    lonely.__dict__["neighbors"] = np.full(mesh.cells.shape, -1, dtype=np.int32)
    return IndexField.from_mesh(
        lonely, field.samples.values, ambient_index=field.ambient_index, interpolation="bilinear", body=field.body
    )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("scene", first_of(SCENES, 4))
def test_the_walk_and_the_bins_find_the_same(scene, precision, engine):
    """300 rays with neighbours and without. A point within rounding of an edge may fall to either cell.

    The contrast is the same on both sides of an edge and its slope is not: such a step's share of the OPD, for one ray
    in hundreds, stays far below 1e-3 wave, and other rays are equal in every bit. At a gap's edge, in float32, one of
    the two sides is empty: nothing is asked of such a ray but that there are few.
    """
    make, middle, half, start, stop, step = SCENES[scene]
    backend, field, rays = on(engine), make(), across(300, middle, half, start, 6)
    settings = {"until": Plane((0, 0, stop), (0, 0, 1)), "method": "fixed", "step": step, "precision": precision}
    walked, binned = (trace(one, rays, **settings, **backend) for one in (field, without_neighbours(field)))
    assert np.array_equal(walked.traced_status, binned.traced_status) and walked.ok.mean() > 0.9
    off = np.abs(walked.opd - binned.opd)
    assert (off == 0.0).mean() > 0.97
    assert (off < 1e-3 * WAVE).mean() > 0.99
    if precision == "float64":
        assert off.max() < 1e-3 * WAVE


# --- meshes far from 0 -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", first_of(["axisymmetric", "planar"]))
def test_float32_is_as_accurate_on_a_mesh_far_from_zero(geometry, engine):
    """A mesh of cells of 0.1 mm, and the same at z = 1 km: equal OPDs within 1e-3 wave and within the reported errors.

    The coordinates' own rounding at 1 km, 1e-13 m, times slopes of the contrast of 1 per metre, is far below.
    """
    mesh = mesh_field("bilinear", geometry)
    start = np.array([[1e-4, 3e-4, -1e-3], [2e-4, -5e-4, -1e-3], [0.0, 7e-4, -1e-3]])
    heading = [[0.0, 0.0, 1.0], [0.02, 0.05, 1.0], [0.0, -0.1, 1.0]]
    found = []
    for shift in (0.0, 1000.0):
        moved = QuadMesh(mesh.samples.mesh.vertices + np.array([0.0, shift]), mesh.samples.mesh.cells, geometry)
        field = IndexField.from_mesh(
            moved, mesh.samples.values, ambient_index=mesh.ambient_index, interpolation="bilinear"
        )
        stop = Plane((0.0, 0.0, shift + 6e-3), (0.0, 0.0, 1.0))
        rays = RayBundle(start + np.array([0.0, 0.0, shift]), heading)
        found.append(trace(field, rays, until=stop, method="adaptive", precision="float32", **on(engine)))
    here, there = found
    assert np.array_equal(here.status, there.status)
    assert np.abs(there.opd - here.opd).max() < 1e-3 * WAVE
    assert (np.abs(there.opd - here.opd) <= here.step_error + there.step_error).all()
