"""The kernels and their arguments, which both engines read from this table; layout.py defines the kinds.

warp/types.py makes the argument types of Warp's kernels from it, and opencl/headers.py the OpenCL header arguments.h.
"""

from .layout import Value

TRACED = (
    Value("field", "Field"),
    Value("bounds", "Bounds"),
    Value("control", "Control"),
    Value("first_ray", "int"),
    Value("position_in", "double3*"),
    Value("direction_in", "double3*"),
    Value("outputs", "RayOutputs"),
)
# Arguments of the kernels. In OpenCL the arrays of a struct are separate arguments, which follow the structs of values,
# and the count that bounds a launch follows the number of its first ray, group or line: see BOUNDS.
KERNELS: dict[str, tuple[Value, ...]] = {
    "trace_kernel": TRACED,
    "leapfrog": (*TRACED, Value("rejected_count_out", "int*")),
    "deliver_bundle": (
        Value("block_map", "int*"),
        Value("header", "double*"),
        Value("patches", "real*"),
        Value("frame", "double*"),
        Value("map_u", "int"),
        Value("map_v", "int"),
        Value("converges", "int"),
        Value("stop", "int"),
        Value("shape", "int"),
        Value("checks_faces", "int"),
        Value("faces_that_matter", "int"),
        Value("requested", "int"),
        Value("first_ray", "int"),
        Value("position_in", "double3*"),
        Value("direction_in", "double3*"),
        Value("outputs", "RayOutputs"),
    ),
    "launch_pupil": (
        Value("center", "double3"),
        Value("first", "double3"),
        Value("second", "double3"),
        Value("look", "double3"),
        Value("shape", "int"),
        Value("row_count", "int"),
        Value("column_count", "int"),
        Value("table_in", "double*"),
        Value("seeds", "uint**"),
        Value("order_in", "int*"),
        Value("per_replicate", "int"),
        Value("generator", "int"),
        Value("smoothed", "int"),
        Value("first_ray", "int"),
        Value("position_out", "double3*"),
        Value("direction_out", "double3*"),
        Value("pupil_out", "double2*"),
        Value("weight_out", "double*"),
    ),
    "sum_rays": (
        Value("wave_number", "double"),
        Value("plane", "double3"),
        Value("focus", "double"),
        Value("per_replicate", "int"),
        Value("first_group", "int"),
        Value("weight_count", "int"),
        Value("weight_in", "double*"),
        Value("pupil_in", "double2*"),
        Value("opd_in", "double*"),
        Value("step_error_in", "double*"),
        Value("evaluation_count_in", "int*"),
        Value("status_in", "int*"),
        Value("sums_out", "double*"),
    ),
    "reduce_sums": (
        Value("row_count", "int"),
        Value("reduced_count", "int"),
        Value("first_sum", "int"),
        Value("sums_in", "double*"),
        Value("sums_out", "double*"),
    ),
    "spline_lines": (
        Value("values_in", "double*"),
        Value("inverse_in", "double*"),
        Value("count", "int"),
        Value("pitch", "int"),
        Value("even", "int"),
        Value("ambient", "double"),
        Value("first_line", "int"),
        Value("coefficients_out", "double*"),
    ),
    "round_coefficients": (
        Value("values_in", "double*"),
        Value("first_place", "int"),
        Value("values_out", "real*"),
    ),
    "column_maxima": (
        Value("coefficients_in", "double*"),
        Value("values_in", "double*"),
        Value("first_count", "int"),
        Value("second_count", "int"),
        Value("third_count", "int"),
        Value("block", "int"),
        Value("ambient", "double"),
        Value("first_place", "int"),
        Value("maxima_out", "double*"),
    ),
    "block_maxima": (
        Value("values_in", "double*"),
        Value("count", "int"),
        Value("pitch", "int"),
        Value("block", "int"),
        Value("first_place", "int"),
        Value("maxima_out", "double*"),
    ),
}
# The kernels that prepare a grid (tracing/grid_tables.py).
GRID_KERNELS = ("spline_lines", "column_maxima", "block_maxima")
# The counts that bound an OpenCL launch, whose size is rounded up to whole work-groups.
BOUNDS = {
    "first_ray": "ray_count",
    "first_group": "group_count",
    "first_sum": "sum_count",
    "first_line": "line_count",
    "first_place": "place_count",
}
