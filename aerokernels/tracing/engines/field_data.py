"""Collect what a kernel needs of a field, a plan and a stop as NumPy data, the same for every backend.

Names are the members of the kernels' structs Field, Bounds and Control, see layout.py. Numbers are float64 here; the
backend rounds them once. A family of rays with its stop and the field's box is an array of floats and a few integers.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.tracing.engines.layout import OPTIONS
from aerokernels.tracing.tasks.family import FAR, LEAST_COSINE, BundleTable
from aerokernels.tracing.tasks.unresolved import lookup_table, missed_at_ends

from ...derived import Derived
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ..error_limit import error_limit, left_out, support_box
from ..plan import TracePlan, output_mask
from ..scheme import LAXEST, MESH_STEP_LIMIT, STEP_LIMIT
from ..step_bound import CONES, cones_of, step_bound
from ..stop import ArcLength, Plane

# How many FieldData of recent bodies and precisions are cached for one set of grid nodes.
KEPT = 16  # speed only
# A mesh whose coordinates exceed so many lengths of its box counts as far from 0.
FAR_BOX = 2.0
# Directions are rounded to single precision before they are compared.
ROUNDED_UP = 1.0 + 1e-6
# Greatest count of steps: the kernels' counters have 32 bits.
MOST_STEPS = 2**31 - 1
# No ray in the box meets a plane further than this from the box, however its last step rounds [cells].
NEAR_BOX = 2.0


@dataclass(frozen=True, eq=False)
class FieldData(Derived):
    """The data of a field for the kernels.

    Attributes:
        arrays: Arrays of struct Field, by name; an array that the field does not use has one row. A grid's
            coefficients are not included, see `array_of`.
        field: Scalars and short vectors of struct Field, by name.
        bounds: Members of struct Bounds, without those of the stop.
        control: Members of struct Control, without those of the stop, the plan and the table of step bounds.
        origin: Position of cell 0 along x, y, z [m].
        spacing: Metres per cell along x, y, z.
    """

    arrays: dict[str, np.ndarray]
    field: dict[str, object]
    bounds: dict[str, object]
    control: dict[str, object]
    origin: np.ndarray
    spacing: np.ndarray


def field_data(field: IndexField, precision: str, with_paper_step: bool) -> FieldData:
    """Return the data of a field for one precision (the edge tolerance of a mesh depends on it), cached on the field.

    Raises:
        ValueError: More coefficients than the kernels' 32-bit index can count.
    """
    key = ("kernel data", precision, with_paper_step)
    if with_paper_step or not field.is_uniform:
        return field.derive(key, lambda: _field_data(field, precision, with_paper_step))
    # Of a grid's data, only the paper's step lengths depend on the contrast: fields on the same nodes share the rest.
    place = *key, field.geometry, field.interpolation, field.ambient_index, field.body
    places = field.samples.places
    return field.derive(key, lambda: places.derive(place, lambda: _field_data(field, precision, False), KEPT))


def array_of(field: IndexField, data: FieldData, name: str) -> np.ndarray:
    """Return an array of struct Field by name, with a grid's coefficients copied from the device that computed them."""
    if name == "coefficients" and isinstance(field.samples, UniformGrid):
        return field.samples.coefficients.ravel()
    return data.arrays[name]


def _field_data(field: IndexField, precision: str, with_paper_step: bool) -> FieldData:
    samples = field.samples
    low, high = field.box
    finite = np.nan_to_num(np.stack([low, high]), posinf=0.0, neginf=0.0)
    arrays: dict[str, np.ndarray] = {name: np.zeros((1, 2)) for name in ("corners", "gradients")}
    arrays |= {name: np.zeros(1) for name in ("coefficients", "values", "paper_step", "kinks")}
    arrays |= {name: np.zeros(1, dtype=np.int32) for name in ("neighbors", "bin_start", "bin_cell")}
    members: dict[str, object] = {
        "row": np.zeros(3, dtype=int),
        "pitch": np.ones(3, dtype=int),
        "ambient": field.ambient_index,
        "mesh_low": np.zeros(2),
        "mesh_high": np.zeros(2),
        "bin_count": np.ones(2, dtype=int),
        "bin_origin": np.zeros(2),
        "bin_rate": np.ones(2),
        "edge_tolerance": 0.0,
        "cell_count": 0,
    }
    if isinstance(samples, UniformGrid):
        spacing, origin = _per_position_axis(field.geometry, samples.spacing, samples.origin)
        members |= _grid_members(samples)
        del arrays["coefficients"]  # see array_of
        if with_paper_step:
            arrays["paper_step"] = samples.paper_step.ravel()
        cell_rate = 1.0 / spacing
    else:
        mesh = samples.mesh
        spacing, origin = np.ones(3), _mesh_origin(field.geometry, mesh.box)
        members |= _mesh_members(mesh, origin[1:], precision)
        gradients = samples.gradients if field.interpolation != "bilinear" else np.zeros_like(mesh.vertices)
        arrays |= {
            "corners": mesh.corners.reshape(-1, 2) - origin[1:],
            "values": samples.values[mesh.cells].ravel(),
            "gradients": gradients[mesh.cells].reshape(-1, 2),
            "neighbors": mesh.neighbors.ravel(),
            "kinks": field.ambient_index * samples.kinks.ravel(),
            "bin_start": mesh.bins.start,
            "bin_cell": mesh.bins.cell,
        }
        if with_paper_step:
            arrays["paper_step"] = np.append(samples.paper_step, np.median(samples.paper_step))
        cell_rate = np.full(3, 1.0 / float(np.median(mesh.cell_size)))
    members["inverse_spacing"] = 1.0 / spacing
    rows, links = (np.zeros((1, 4)),) * 3, np.zeros((1, 3), np.int32)
    members["wall_count"] = 0
    if field.body is not None:
        rows, links = field.body.tree.kernel_rows, field.body.tree.links
        members["wall_count"] = len(links)
    arrays |= dict(zip(("wall", "wall_normals", "wall_boxes"), rows, strict=True)) | {"wall_links": links}
    radius = float(samples.high[0]) if field.geometry == "axisymmetric" else 0.0
    bounds = {
        "origin": origin,
        "spacing": spacing,
        "low": finite[0],
        "high": finite[1],
        "radius": radius,
        "ambient": field.ambient_index,
    }
    control = {
        "face_low": (finite[0] - origin) / spacing,
        "face_high": _whole((finite[1] - origin) / spacing),
        "radius": radius / spacing[0],
        "cell_rate": cell_rate,
        "extent": 4.0 * float(np.linalg.norm(finite[1] - finite[0])),
        "step_limit": STEP_LIMIT if field.is_uniform else MESH_STEP_LIMIT,
    }
    return FieldData(arrays, members, bounds, control, origin, spacing)


def _grid_members(samples: UniformGrid) -> dict[str, object]:
    shape = samples.coefficient_shape
    if math.prod(shape) >= 2**31:
        raise ValueError(f"{math.prod(shape)} coefficients do not fit the kernel's 32-bit index: use a coarser grid")
    pitch = [1] * 3
    for axis in range(len(shape) - 2, -1, -1):
        pitch[axis] = pitch[axis + 1] * shape[axis + 1]
    row = [n - 2 for n in samples.shape] + [0] * (3 - len(samples.shape))
    return {"row": np.array(row), "pitch": np.array(pitch)}


def _mesh_origin(geometry: str, box: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the origin of kernel coordinates on a mesh [m]: along axes on which the mesh is far from 0, its middle.

    Kernels round coordinates on a mesh to their precision, and float32 would lose the place in a cell far from 0.
    """
    low, high = box
    is_far = np.maximum(np.abs(low), np.abs(high)) > FAR_BOX * (high - low)
    if geometry == "axisymmetric":
        is_far[0] = False  # the radius counts from the axis
    return np.array([0.0, *np.where(is_far, 0.5 * (low + high), 0.0)])


def _mesh_members(mesh, origin: np.ndarray, precision: str) -> dict[str, object]:
    low, high = (corner - origin for corner in mesh.box)
    extent = float(np.abs(np.stack([low, high])).max())
    return {
        "mesh_low": low,
        "mesh_high": high,
        "bin_count": np.array(mesh.bins.count),
        "bin_origin": mesh.bins.origin - origin,
        "bin_rate": 1.0 / mesh.bins.size,
        "edge_tolerance": extent * (4e-7 if precision == "float32" else 1e-13),
        "cell_count": len(mesh.cells),
    }


def _per_position_axis(geometry: str, spacing, origin) -> tuple[np.ndarray, np.ndarray]:
    if geometry == "volume":
        return np.array(spacing), np.array(origin)
    if geometry == "planar":
        return np.array([spacing[0], *spacing]), np.array([0.0, *origin])
    return np.array([spacing[0], spacing[0], spacing[1]]), np.array([0.0, 0.0, origin[1]])


def _whole(cells: np.ndarray) -> np.ndarray:
    """Round counts of cells that differ from a whole number only by rounding errors."""
    near = np.round(cells)
    return np.where(np.abs(cells - near) < 1e-9 * np.maximum(near, 1.0), near, cells)


def stop_kind(until) -> str:
    """Return the kind of a stop: "none", "plane" or "arc"."""
    return {Plane: "plane", ArcLength: "arc"}.get(type(until), "none")


def plan_members(plan: TracePlan, outputs: frozenset) -> dict[str, object]:
    """Return the members of Control that depend on the plan and the requested outputs alone."""
    return {
        "steepest": ROUNDED_UP * np.array(plan.steepest or (1.0, 1.0, 1.0)),
        "quadrature_error_scale": plan.quadrature_error_scale,
        "trajectory_error_scale": plan.trajectory_error_scale,
        "sample_count": plan.sample_count,
        "outputs": output_mask(outputs),
    }


def trace_members(field: IndexField, data: FieldData, plan: TracePlan, until, wavelength: float) -> tuple[dict, dict]:
    """Return the members of Bounds and of Control that depend on the field, the plan and the stop."""
    bounds: dict[str, object] = {"plane_point": np.zeros(3), "plane_normal": np.zeros(3), "length": 0.0}
    bounds |= _support_members(field, plan, wavelength)
    control: dict[str, object] = {
        "plane_normal": np.zeros(3),
        "plane_offset": 0.0,
        "plane_in_box": 0,
        "step": plan.sampling.spacing if plan.sample_count and plan.sampling else plan.step or 0.0,
        "tolerance": error_limit(field, plan.tolerance * wavelength),
        "max_steps": min(plan.max_steps, MOST_STEPS),
    }
    control |= _left_members(field, plan, wavelength)
    if isinstance(until, Plane):
        bounds |= {"plane_point": until.point, "plane_normal": until.normal}
        control["plane_normal"] = until.normal * data.spacing
        control["plane_offset"] = float(until.normal @ (until.point - data.origin))
        margin = NEAR_BOX * float(np.max(data.spacing))
        control["plane_in_box"] = int(_comes_near(until, field.box, margin))
    elif isinstance(until, ArcLength):
        bounds["length"] = until.length
    return bounds, control


def _comes_near(plane: Plane, box: tuple[np.ndarray, np.ndarray], margin: float) -> bool:
    """Whether a plane comes within a margin [m] of a box, which may be infinite along an axis."""
    turned = plane.normal != 0.0
    ends = np.stack(box)[:, turned] * plane.normal[turned]
    offset = float(plane.normal @ plane.point)
    return bool(ends.min(axis=0).sum() - offset <= margin and ends.max(axis=0).sum() - offset >= -margin)


def _support_members(field: IndexField, plan: TracePlan, wavelength: float) -> dict[str, object]:
    """Return the members for the field's support, which only leapfrog samples use."""
    if not plan.sample_count:
        return {"support_low": np.zeros(3), "support_high": np.zeros(3), "support_radius": 0.0}
    low, high = support_box(field, error_limit(field, plan.tolerance * wavelength), plan.lever_arms)
    radius = float(high[0]) if field.geometry == "axisymmetric" else 0.0
    missing = np.zeros(3 - len(low))
    return {
        "support_low": np.concatenate([missing, low]),
        "support_high": np.concatenate([missing, high]),
        "support_radius": radius,
    }


def _left_members(field: IndexField, plan: TracePlan, wavelength: float) -> dict[str, object]:
    """Bound what leapfrog samples leave out: the potential outside the support, and its slope [1/m]."""
    if not plan.sample_count:
        return {"left_potential": 0.0, "left_slope": 0.0}
    potential, slope = left_out(field, error_limit(field, plan.tolerance * wavelength), plan.lever_arms)
    # A spline's slope is below twice its greatest coefficient over the spacing.
    return {
        "left_potential": potential,
        "left_slope": min(slope, 2.0 * potential / float(np.min(field.samples.spacing))),
    }


def step_bound_tables(
    field: IndexField, plan: TracePlan, wavelength: float, directions: np.ndarray
) -> tuple[dict, dict]:
    """Return the tables of step bounds for the cones that contain the directions.

    There are none without error control or on a mesh. For leapfrog samples the table of the error from features between
    samples (unresolved.py) takes their place if the plan has one: the first entry of "step_bound_start" is then 0. The
    second one is where the table of the ends of rays starts, if there is one.

    Returns:
        Arrays "step_bound" [m], flat, and "step_bound_start", -1 for a cone without a table; members of Control.
    """
    start = np.full(len(CONES), -1, dtype=np.int32)
    lengths = [np.zeros(1)]
    members: dict[str, object] = {"block_count": np.ones(3, dtype=int), "block": 1}
    if plan.sample_count and plan.sampling is not None:
        block, missed = lookup_table(field, plan.sampling)
        start[0], lengths = 0, [missed.ravel()]
        at_ends = missed_at_ends(field, plan.sampling, False)
        if at_ends is not None:
            start[1] = missed.size
            lengths.append(at_ends.ravel())
        members = {"block_count": np.array([*missed.shape, *[1] * (3 - missed.ndim)]), "block": block}
    if isinstance(field.samples, UniformGrid) and plan.method in ("adaptive", "straight") and not plan.sample_count:
        budget = error_limit(field, min(plan.tolerance, LAXEST) * wavelength)
        for cone in np.unique(cones_of(directions, field.geometry)):
            table = step_bound(field.samples, field.geometry, budget, CONES[cone])
            start[cone] = sum(part.size for part in lengths)
            lengths.append(table.length.ravel())
            shape = table.length.shape
            members = {"block_count": np.array([*shape, *[1] * (3 - len(shape))]), "block": table.block}
    return {"step_bound": np.concatenate(lengths), "step_bound_start": start}, members


def _numbered(option: str) -> dict[str, int]:
    """The choices of an option as the header options.h numbers them."""
    choices = OPTIONS[option].choices
    assert isinstance(choices, tuple)
    return {name: number for number, name in enumerate(choices, start=1)}


STOPS, SHAPES = _numbered("stop"), _numbered("geometry")


def kernel_arrays(table: BundleTable) -> list[np.ndarray]:
    """The kernels' arrays, flat: block_map, header, patches, frame; deliver_bundle.py reads `frame` by place."""
    family, until, field = table.family, table.classes.until, table.classes.field
    start = np.zeros(3) if family.start_point is None else family.start_point
    frame: list[Any] = [family.low, table.rate, family.origin, family.axes, start, family.start_normal]  # 22 numbers
    frame += [[family.start_point is not None, family.ahead, family.close, LEAST_COSINE]]
    frame += [until.point, until.normal] if isinstance(until, Plane) else [np.zeros(3), np.array([0.0, 0.0, 1.0])]
    frame += [[until.length if isinstance(until, ArcLength) else 0.0], *field.box]
    frame += [[field.ambient_index, table.classes.margin]]
    numbers = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in frame])
    assert len(numbers) == 41
    return [table.map.ravel(), table.header.ravel(), table.values.ravel(), np.clip(numbers, -FAR, FAR)]


def kernel_numbers(table: BundleTable, outputs: frozenset) -> list[int]:
    """The scalar arguments of the kernel up to the rays: from map_u to outputs."""
    until = table.classes.until
    stop = STOPS["plane" if isinstance(until, Plane) else "none" if until is None else "arc"]
    faces = sum(1 << face for face, matters in enumerate(table.classes.matters) if matters)
    shape = SHAPES[table.classes.field.geometry]
    checks = not table.classes.are_all_alike
    return [*table.map.shape, int(table.family.converges), stop, shape, int(checks), faces, output_mask(outputs)]
