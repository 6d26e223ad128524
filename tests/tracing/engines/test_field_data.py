"""What kernels get from a field, a plan and a stop, number by number."""

import dataclasses

import numpy as np
import pytest

from aerokernels import ArcLength, Body, IndexField, Plane, QuadMesh
from aerokernels.tracing.engines import field_data as made
from aerokernels.tracing.error_limit import error_limit, greatest_path, left_out, path_exceeds, support_box
from aerokernels.tracing.leapfrog.unresolved import Sampling, lookup_table, missed_at_ends
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.result import output_mask
from aerokernels.tracing.step_bound import CONES, cones_of, greatest_turn, predict_evaluations, step_bound
from aerokernels.tracing.straight_lines import LeverArms
from tests.random_air import random_air

ORIGIN, SPACING, COUNTS = np.array([-1.0, -1.5, 1.0]), np.array([0.5, 0.75, 1.1]), (6, 5, 7)
PLAN = TracePlan("adaptive", "warp", "cpu", "float32", 100, None, 1e-3, ())
GEOMETRIES = ("volume", "planar", "axisymmetric")


def grid_field(
    geometry: str, interpolation: str = "cubic", scale: float = 1e-4, body: Body | None = None
) -> IndexField:
    return random_air(
        geometry, 121, lambda random, shape: scale * random.uniform(-1.0, 2.0, shape), COUNTS, ORIGIN, SPACING,
        ambient_index=1.25, interpolation=interpolation, body=body,
    )  # fmt: skip


def mesh_field(geometry: str, low: float = 0.0, height: float = 1.0, interpolation: str = "bilinear") -> IndexField:
    y, z = np.meshgrid(np.linspace(low, low + 1.2, 4), np.linspace(height, height + 1.5, 5), indexing="ij")
    values = 1e-4 * np.random.default_rng(122).uniform(-1.0, 2.0, (4, 5))
    mesh = QuadMesh.structured(y, z + 0.2 * (y - low), geometry)
    return IndexField.from_mesh(mesh, values, ambient_index=1.25, interpolation=interpolation)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_a_grid(geometry: str):
    """Along x, y and z: origins and spacings, rates, boxes in metres and in cells, rows and pitches of coefficients."""
    field = grid_field(geometry)
    found = made.field_data(field, "float32", True)
    origin, spacing = ORIGIN.copy(), SPACING.copy()
    low, high = ORIGIN.copy(), ORIGIN + SPACING * (np.array(COUNTS) - 1)
    if geometry == "planar":
        origin[0], spacing[0], low[0], high[0] = 0.0, SPACING[1], 0.0, 0.0
    if geometry == "axisymmetric":
        origin[:2], spacing[:2], radius = 0.0, SPACING[1], SPACING[1] * 4
        low[:2], high[:2] = -radius, radius
    np.testing.assert_allclose(found.origin, origin)
    np.testing.assert_allclose(found.spacing, spacing)
    np.testing.assert_allclose(found.field["inverse_spacing"], 1.0 / spacing)
    assert found.field["ambient"] == found.bounds["ambient"] == 1.25
    counts = COUNTS if geometry == "volume" else COUNTS[1:]
    assert found.field["row"].tolist() == [n - 2 for n in counts] + [0] * (3 - len(counts))
    pitch = {"volume": [7 * 9, 9, 1], "planar": [9, 1, 1], "axisymmetric": [9, 1, 1]}[geometry]
    assert found.field["pitch"].tolist() == pitch
    for name, value in (("low", low), ("high", high), ("origin", origin), ("spacing", spacing)):
        np.testing.assert_allclose(found.bounds[name], value, atol=1e-15)
    assert found.bounds["radius"] == (4 * SPACING[1] if geometry == "axisymmetric" else 0.0)
    assert found.control["radius"] == (4.0 if geometry == "axisymmetric" else 0.0)
    np.testing.assert_allclose(found.control["face_low"], (low - origin) / spacing, atol=1e-15)
    np.testing.assert_allclose(found.control["face_high"], (high - origin) / spacing, atol=1e-15)
    np.testing.assert_allclose(found.control["cell_rate"], 1.0 / spacing)
    assert found.control["extent"] == pytest.approx(4.0 * np.linalg.norm(high - low))
    assert found.control["step_limit"] == 2.0
    np.testing.assert_array_equal(found.arrays["paper_step"], field.samples.paper_step.ravel())
    np.testing.assert_array_equal(made.array_of(field, found, "coefficients"), field.samples.coefficients.ravel())
    assert made.field_data(field, "float32", False).arrays["paper_step"].tolist() == [0.0]
    assert found.field["wall_count"] == found.field["cell_count"] == 0 and found.field["edge_tolerance"] == 0.0
    for name, shape in (
        ("corners", (1, 2)),
        ("gradients", (1, 2)),
        ("values", (1,)),
        ("wall", (1, 4)),
        ("wall_links", (1, 3)),
    ):
        assert found.arrays[name].shape == shape and not found.arrays[name].any()
    assert found.field["bin_count"].tolist() == [1, 1] and found.field["bin_rate"].tolist() == [1.0, 1.0]
    monotone = made.field_data(grid_field(geometry, "monotone"), "float32", False)
    if geometry != "volume":
        assert monotone.field["pitch"].tolist() == [14, 1, 1]


@pytest.mark.parametrize("interpolation", ["bilinear", "bilinear-barron"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_a_mesh(geometry: str, precision: str, interpolation: str):
    """Corners and values of cells, neighbours and bins; far from 0 coordinates count from the middle of the box."""
    for low, height in ((0.0, 1.0), (0.0, 50.0), (40.0, 1.0)):
        field = mesh_field(geometry, low, height, interpolation)
        mesh = field.mesh
        found = made.field_data(field, precision, True)
        first, last = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        if geometry == "axisymmetric":
            first[0] = 0.0  # the box begins at the axis: a hole about it is no cell
        far = np.array([low > 9.0 and geometry == "planar", height > 9.0])
        origin = np.where(far, 0.5 * (first + last), 0.0)
        np.testing.assert_allclose(found.origin, [0.0, *origin])
        assert found.spacing.tolist() == [1.0] * 3 and found.field["inverse_spacing"].tolist() == [1.0] * 3
        np.testing.assert_allclose(found.field["mesh_low"], first - origin, atol=1e-12)
        np.testing.assert_allclose(found.field["mesh_high"], last - origin, atol=1e-12)
        extent = np.abs([first - origin, last - origin]).max()
        tolerance = {"float32": 4e-7, "float64": 1e-13}[precision]
        assert found.field["edge_tolerance"] == pytest.approx(extent * tolerance, abs=0.0)
        assert found.field["cell_count"] == 12 and found.field["bin_count"].tolist() == list(mesh.bins.count)
        np.testing.assert_allclose(found.field["bin_origin"], mesh.bins.origin - origin)
        np.testing.assert_allclose(found.field["bin_rate"], 1.0 / mesh.bins.size)
        np.testing.assert_allclose(found.arrays["corners"], (mesh.vertices[mesh.cells] - origin).reshape(-1, 2))
        np.testing.assert_array_equal(found.arrays["values"], field.samples.values[mesh.cells].ravel())
        expected = 0.0 if interpolation == "bilinear" else field.samples.gradients[mesh.cells].reshape(-1, 2)
        np.testing.assert_array_equal(found.arrays["gradients"], np.zeros((48, 2)) + expected)
        np.testing.assert_array_equal(found.arrays["neighbors"], mesh.neighbors.ravel())
        np.testing.assert_array_equal(found.arrays["bin_cell"], mesh.bins.cell)
        np.testing.assert_array_equal(found.arrays["bin_start"], mesh.bins.start)
        steps = field.samples.paper_step
        np.testing.assert_array_equal(found.arrays["paper_step"], [*steps, np.median(steps)])
        np.testing.assert_allclose(found.control["cell_rate"], 1.0 / np.median(mesh.cell_size))
        assert found.control["step_limit"] == 4.0
        assert found.bounds["radius"] == (last[0] if geometry == "axisymmetric" else 0.0)
        assert made.field_data(field, precision, False).arrays["paper_step"].tolist() == [0.0]


def test_the_walls_of_a_body():
    """Rows and boxes of its tree, and their number."""
    body = Body([[0.0, 2.0], [1.0, 3.0], [0.0, 4.0]], "axisymmetric")
    found = made.field_data(grid_field("axisymmetric", body=body), "float64", False)
    rows, normals, boxes = body.tree.kernel_rows
    np.testing.assert_array_equal(found.arrays["wall"], rows)
    np.testing.assert_array_equal(found.arrays["wall_normals"], normals)
    np.testing.assert_array_equal(found.arrays["wall_boxes"], boxes)
    np.testing.assert_array_equal(found.arrays["wall_links"], body.tree.links)
    assert found.field["wall_count"] == len(body.tree.boxes) > 0


def test_whole_numbers_of_cells():
    """A count off a whole number by rounding becomes that number; others are kept."""
    given = np.array([5.0 + 4e-9, 5.0 + 6e-9, 0.3, 7.5, 1e-10])
    np.testing.assert_array_equal(made._whole(given), [5.0, 5.0 + 6e-9, 0.3, 7.5, 0.0])


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_stops_and_plans(geometry: str):
    """Planes in cells from the grid's origin, lengths of arc, steps, tolerances, scales and outputs."""
    field = grid_field(geometry)
    data = made.field_data(field, "float32", False)
    plane = Plane((0.2, 0.3, 2.5), (0.3, -0.4, 1.2))
    bounds, control = made.trace_members(field, data, PLAN, plane, 1e-6)
    np.testing.assert_array_equal(bounds["plane_point"], plane.point)
    np.testing.assert_array_equal(bounds["plane_normal"], plane.normal)
    np.testing.assert_allclose(control["plane_normal"], plane.normal * data.spacing)
    place = np.array([0.3, -0.2, 1.7])  # its height in cells is that in metres
    height = (data.origin + data.spacing * place - plane.point) @ plane.normal
    assert place @ control["plane_normal"] - control["plane_offset"] == pytest.approx(height, rel=1e-12)
    assert control["plane_in_box"] == 1 and bounds["length"] == 0.0
    assert control["tolerance"] == pytest.approx(error_limit(field, 1e-9), abs=0.0)
    assert control["max_steps"] == 100 and control["step"] == 0.0
    far = made.trace_members(field, data, PLAN, Plane((0.0, 0.0, 99.0), (0.0, 0.0, 1.0)), 1e-6)[1]
    assert far["plane_in_box"] == 0
    bounds, control = made.trace_members(field, data, PLAN, ArcLength(2.5), 1e-6)
    assert bounds["length"] == 2.5 and not bounds["plane_normal"].any() and not control["plane_normal"].any()
    fixed = dataclasses.replace(PLAN, method="fixed", step=0.7, max_steps=2**40)
    control = made.trace_members(field, data, fixed, None, 1e-6)[1]
    assert control["step"] == 0.7 and control["max_steps"] == 2**31 - 1
    assert control["plane_in_box"] == 0 and control["plane_offset"] == 0.0
    assert control["left_potential"] == control["left_slope"] == 0.0
    assert [made.stop_kind(one) for one in (None, plane, ArcLength(1.0))] == ["none", "plane", "arc"]
    scaled = dataclasses.replace(PLAN, quadrature_error_scale=0.3, trajectory_error_scale=0.7, sample_count=36)
    members = made.plan_members(scaled, frozenset(("opd", "direction")))
    assert members["quadrature_error_scale"] == 0.3 and members["trajectory_error_scale"] == 0.7
    assert members["sample_count"] == 36 and members["outputs"] == output_mask(frozenset(("opd", "direction")))


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_leapfrog_samples_are_told_of_the_support(geometry: str):
    """Its corners along x, y and z, its radius, and what lies outside: at most twice the potential over a cell."""
    field = grid_field(geometry)
    data = made.field_data(field, "float32", False)
    sampling = Sampling(0.8, (0.1, 0.2, 1.0), 0.0)
    for arms in (None, LeverArms(9.0, 9.0, 40.0)):
        plan = dataclasses.replace(PLAN, method="leapfrog", sample_count=36, sampling=sampling, lever_arms=arms)
        bounds, control = made.trace_members(field, data, plan, None, 1e-6)
        limit = error_limit(field, 1e-9)
        low, high = support_box(field, limit, arms)
        np.testing.assert_array_equal(bounds["support_low"], [*[0.0] * (3 - len(low)), *low])
        np.testing.assert_array_equal(bounds["support_high"], [*[0.0] * (3 - len(low)), *high])
        assert bounds["support_radius"] == (high[0] if geometry == "axisymmetric" else 0.0)
        potential, slope = left_out(field, limit, arms)
        assert control["left_potential"] == potential and control["step"] == 0.8
        assert control["left_slope"] == min(slope, 2.0 * potential / min(field.samples.spacing))
    even = dataclasses.replace(PLAN, sample_count=36)
    assert made.trace_members(field, data, even, None, 1e-6)[1]["step"] == 0.0
    none = made.trace_members(field, data, PLAN, None, 1e-6)[0]
    assert not none["support_low"].any() and none["support_radius"] == 0.0


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_tables_of_step_bounds(geometry: str):
    """One for each cone that the directions pick, one after the other behind a 0; none on a mesh or without control."""
    field = grid_field(geometry)
    way = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.05, 1.0]])
    way /= np.linalg.norm(way, axis=1)[:, None]
    arrays, members = made.step_bound_tables(field, PLAN, 1e-6, way)
    cones = np.unique(cones_of(way, geometry))
    assert len(cones) >= 2 and arrays["step_bound"][0] == 0.0 and len(arrays["step_bound_start"]) == len(CONES)
    budget, begin = error_limit(field, 1e-9), 1
    for number in range(len(CONES)):
        start = arrays["step_bound_start"][number]
        if number not in cones:
            assert start == -1
            continue
        table = step_bound(field.samples, geometry, budget, CONES[number])
        assert start == begin and members["block"] == table.block
        np.testing.assert_array_equal(arrays["step_bound"][start : start + table.length.size], table.length.ravel())
        begin += table.length.size
        assert members["block_count"].tolist() == [*table.length.shape, 1, 1][:3]
    assert begin == len(arrays["step_bound"])
    for other, plan in ((mesh_field("planar"), PLAN), (field, dataclasses.replace(PLAN, method="fixed"))):
        arrays, members = made.step_bound_tables(other, plan, 1e-6, way)
        assert (arrays["step_bound_start"] == -1).all() and arrays["step_bound"].tolist() == [0.0]
        assert members["block"] == 1 and members["block_count"].tolist() == [1, 1, 1]
    sampling = Sampling(0.8, (0.1, 0.2, 1.0), 0.0)
    plan = dataclasses.replace(PLAN, method="leapfrog", sample_count=36, sampling=sampling)
    arrays, members = made.step_bound_tables(field, plan, 1e-6, way)
    block, table = lookup_table(field, sampling)
    assert arrays["step_bound_start"].tolist() == [0] + [-1] * (len(CONES) - 1)
    np.testing.assert_array_equal(arrays["step_bound"], table.ravel())
    assert members["block"] == block and members["block_count"].tolist() == [*table.shape, 1, 1][:3]
    sampling = dataclasses.replace(sampling, ends=bytes([255] * (1 + table.size // 8)))
    arrays, _ = made.step_bound_tables(field, dataclasses.replace(plan, sampling=sampling), 1e-6, way)
    assert arrays["step_bound_start"].tolist() == [0, table.size] + [-1] * (len(CONES) - 2)
    np.testing.assert_array_equal(arrays["step_bound"][table.size :], missed_at_ends(field, sampling).ravel())
    lax = dataclasses.replace(PLAN, tolerance=50.0)  # no structure is stepped over for more than 0.3 waves
    strict = dataclasses.replace(PLAN, tolerance=0.3)
    found = [made.step_bound_tables(field, one, 1e-6, way)[0]["step_bound"] for one in (lax, strict)]
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_error_allowed_in_weak_air(geometry: str, monkeypatch):
    """A thousandth of the greatest line integral along an axis, where the tolerance is more than that."""
    field = grid_field(geometry)
    samples, spacing = np.abs(field.samples.samples), field.samples.spacing
    greatest = max((samples.sum(axis=k) * spacing[k]).max() for k in range(samples.ndim))
    assert greatest_path(field) == pytest.approx(greatest, rel=1e-12)
    for share, above in ((0.99, True), (1.01, False), (1e-3, True), (1e9, False)):
        assert path_exceeds(field, share * greatest) == above
    assert error_limit(field, 0.99e-3 * greatest) == 0.99e-3 * greatest
    assert error_limit(field, 1.5e-3 * greatest) == pytest.approx(1e-3 * greatest, rel=1e-12)
    still = grid_field(geometry, scale=0.0)
    assert error_limit(still, 1e-9) == 1e-9 and greatest_path(still) == 0.0
    assert error_limit(grid_field(geometry, scale=1e-28), 1e-9) == 1e-24
    mesh = mesh_field("planar")
    assert error_limit(mesh, 1e-9) == 1e-9 and greatest_path(mesh) == 0.0 and not path_exceeds(mesh, 0.0)
    slope = max(np.abs(np.diff(field.samples.samples, axis=k)).max() / spacing[k] for k in range(samples.ndim))
    size = np.linalg.norm(np.array(field.samples.high) - field.samples.low)
    assert greatest_turn(field.samples) == pytest.approx(slope * size / 1.25, rel=1e-12)
    monkeypatch.setattr("aerokernels.tracing.step_bound.SLAB", 1)  # row by row
    assert greatest_turn(grid_field(geometry).samples) == pytest.approx(slope * size / 1.25, rel=1e-12)


def test_evaluations_are_predicted_from_the_step_bounds():
    """1.5 times 3 over the mean step along the diagonal, and 15, of the worst cone; by cells elsewhere."""
    field = grid_field("volume")
    way = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    extent = np.linalg.norm(np.array(field.samples.high) - field.samples.low)
    worst = []
    for number in np.unique(cones_of(way, "volume")):
        table = step_bound(field.samples, "volume", 1e-9, CONES[number]).length
        worst.append(15.0 + 4.5 * extent * np.mean(1.0 / np.clip(table, 2 * 0.5, extent)))
    assert predict_evaluations(field, 1e-9, way) == pytest.approx(max(worst), rel=1e-12)
    cells = 5 + 4 + 6
    for name, cost in (("linear", 2.0), ("monotone", 3.0)):
        assert predict_evaluations(grid_field("volume", name), 1e-9, way) == pytest.approx(cost * cells)
    mesh = mesh_field("planar")
    expected = 3.0 * np.linalg.norm(np.ptp(mesh.mesh.vertices, axis=0)) / np.median(mesh.mesh.cell_size)
    assert predict_evaluations(mesh, 1e-9, way) == pytest.approx(expected)
