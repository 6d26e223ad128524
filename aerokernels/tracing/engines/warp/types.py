"""Data types of the Warp kernels, one set per precision."""

import functools
from types import SimpleNamespace

import warp as wp

REAL = {"float32": wp.float32, "float64": wp.float64}


@functools.cache
def types(precision: str) -> SimpleNamespace:
    """The scalar, vector and struct types of one precision.

    Positions inside kernels are in cells: a whole part `cell` and a fraction `frac` along each of x, y, z, so that a
    lookup is exact to a rounding of the cell and not of the box. Axes that have no cells of their own (x and y of an
    axisymmetric field, all of a mesh) keep cell = 0.
    """
    real = REAL[precision]
    vec2 = wp.types.vector(2, real)
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)

    class Field:
        coefficients: wp.array(dtype=real)  # uniform grid: of the potential, see medium/spline.py, flat
        row: wp.vec3i  # nodes less one along each local axis, for clamping
        pitch: wp.vec3i  # distance in the flat array of neighbours along each local axis
        inverse_spacing: vec3  # cells per metre along x, y, z
        ambient: real
        corners: wp.array(dtype=vec2)  # mesh: four corners of each cell
        values: wp.array(dtype=real)  # mesh: contrast at those corners
        gradients: wp.array(dtype=vec2)  # mesh: node gradients at those corners
        neighbors: wp.array(dtype=wp.int32)  # mesh: cell behind each edge of each cell, or -1
        mesh_low: vec2  # bounding box of the mesh [m]
        mesh_high: vec2
        bin_start: wp.array(dtype=wp.int32)
        bin_cell: wp.array(dtype=wp.int32)
        bin_count: wp.vec2i
        bin_origin: vec2
        bin_rate: vec2  # bins per metre
        slack: real  # containment slack [m]
        cell_count: wp.int32  # of the mesh
        paper_step: wp.array(dtype=real)  # eq 5 for each cell [m]
        wall: wp.array(dtype=wp.vec4d)  # the body's surface in segments, see medium/wall_tree.py [m]
        wall_boxes: wp.array(dtype=wp.vec4d)  # boxes about them [m]
        wall_links: wp.array(dtype=wp.vec3i)
        wall_count: wp.int32  # boxes about the body's surface

    class Bounds:
        origin: wp.vec3d  # where cell = 0, frac = 0 lies [m]
        spacing: wp.vec3d  # metres per cell
        low: wp.vec3d  # box [m]
        high: wp.vec3d
        radius: wp.float64  # of an axisymmetric box
        support_low: wp.vec3d  # the part of it outside which the air is uniform [m]
        support_high: wp.vec3d
        support_radius: wp.float64
        ambient: wp.float64
        plane_point: wp.vec3d
        plane_normal: wp.vec3d
        length: wp.float64

    class Control:
        face_low: vec3  # box in cells
        face_high: vec3
        radius: real  # in cells
        plane_normal: vec3  # per cell, so that plane_normal . cells - plane_offset is in metres
        plane_offset: real
        cell_rate: vec3  # typical cells per metre, for limits on the step
        # "fixed": metres of arc length; leapfrog samples: greatest distance between two that `step_bound` holds for
        step: real
        step_limit: real  # step in cells that needs no leave from `step_bound`
        # Uniform grid: step bound in each block [m], see step_bound.py; for leapfrog samples the error of
        # the path per metre of it in each block, see unresolved.py.
        step_bound: wp.array(dtype=real)
        step_bound_start: wp.array(
            dtype=wp.int32
        )  # where each cone's table starts in `step_bound`; -1 where it has none
        block_count: wp.vec3i  # blocks along each local axis
        block: wp.int32  # cells in a block
        tolerance: real  # OPD error allowed for the whole ray [m]
        extent: real  # a few diagonals of the box, longer than any step [m]
        max_steps: wp.int32
        quadrature_error_scale: real  # leapfrog samples: the share of a difference that is taken for the error
        trajectory_error_scale: real  # and that of int P^2 / w dt
        sample_count: wp.int32  # of a ray whose samples are even, a multiple of three
        left_potential: real  # greatest potential outside the support, and its slope [1/m]
        left_slope: real
        outputs: wp.int32  # of a ray that are wanted, a bit each, see result.py

    class Course:  # of the undisturbed ray; distances along it [m]
        enter: wp.float64  # where the first step begins
        far: wp.float64  # where it leaves the box, or stops before that
        stop_distance: wp.float64
        has_stop: wp.bool  # whether it ever gets to the stop
        meets: wp.bool  # whether it meets the box before the stop
        side: real  # times this, the normal of the stop plane points away from where the ray starts

    return SimpleNamespace(
        real=real,
        vec2=vec2,
        vec3=vec3,
        vec4=vec4,
        Field=wp.struct(Field),
        Bounds=wp.struct(Bounds),
        Control=wp.struct(Control),
        Course=wp.struct(Course),
    )
