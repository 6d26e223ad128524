"""The structs and compile options of the kernels, which both engines read from these tables.

warp/types.py makes Warp's structs from them, and opencl/headers.py the OpenCL headers types.h and options.h. The
kernels' arguments are in kernel_table.py.

A kind is a type of OpenCL C: int, uint, bool, real (of the kernel's precision) or double, or a vector of 2 to 4 such
numbers; one star makes it an array in device memory, two stars an array with two indices. Structs are kinds, too.

Positions inside kernels are in cells: a whole part `cell` and a fraction `frac` along each of x, y, z, so that a lookup
rounds relative to the size of a cell and not of the box. Axes without cells of their own (x and y of an axisymmetric
field, all axes of a mesh) have cell = 0.
"""

import re
from typing import NamedTuple

import numpy as np

REAL_TYPES: dict[str, type] = {"float32": np.float32, "float64": np.float64}


_KIND = re.compile(r"([A-Za-z]+)(\d?)(\**)")


class Value(NamedTuple):
    """A member of a struct, or an argument of a kernel."""

    name: str
    kind: str
    meaning: str = ""

    @property
    def parts(self) -> tuple[str, int, int]:
        """The type of one number or struct, the length of a vector (1 for a scalar), and the number of indices."""
        found = _KIND.fullmatch(self.kind)
        if found is None:
            raise ValueError(f"{self.name}: {self.kind!r} is no kind, see layout.py")
        return found[1], int(found[2] or 1), len(found[3])

    def number_type(self, precision: str = "float64") -> type:
        """Return the NumPy type of its numbers."""
        plain = {"int": np.int32, "uint": np.uint32, "bool": np.int32, "double": np.float64}
        return {**plain, "real": REAL_TYPES[precision]}[self.parts[0]]


# Members in order; lengths are in metres unless the meaning says otherwise.
STRUCTS: dict[str, tuple[Value, ...]] = {
    "Field": (
        Value("coefficients", "real*", "uniform grid: of the potential, see medium/spline.py, flat"),
        Value("row", "int3", "nodes less one along each local axis, for clamping"),
        Value("pitch", "int3", "distance in the flat array of neighbours along each local axis"),
        Value("inverse_spacing", "real3", "cells per metre along x, y, z"),
        Value("ambient", "real"),
        Value("corners", "real2*", "mesh: four corners of each cell"),
        Value("values", "real*", "mesh: contrast at those corners"),
        Value("gradients", "real2*", "mesh: node gradients at those corners"),
        Value("neighbors", "int*", "mesh: cell behind each edge of each cell, or -1"),
        Value("mesh_low", "real2", "bounding box of the mesh"),
        Value("mesh_high", "real2"),
        Value("bin_start", "int*"),
        Value("bin_cell", "int*"),
        Value("bin_count", "int2"),
        Value("bin_origin", "real2"),
        Value("bin_rate", "real2", "bins per metre"),
        Value("edge_tolerance", "real", "within which a point beside a cell lies in it"),
        Value("cell_count", "int", "of the mesh"),
        Value("paper_step", "real*", "eq 5 for each cell"),
        Value("wall", "double4*", "the body's surface in segments or triangles, see medium/wall_tree.py"),
        Value("wall_boxes", "double4*", "boxes about them"),
        Value("wall_links", "int3*"),
        Value("wall_count", "int", "boxes about the body's surface"),
    ),
    "Bounds": (
        Value("origin", "double3", "where cell = 0, frac = 0 lies"),
        Value("spacing", "double3", "metres per cell"),
        Value("low", "double3", "box"),
        Value("high", "double3"),
        Value("radius", "double", "of an axisymmetric box"),
        Value("support_low", "double3", "the part of it outside which the air is uniform"),
        Value("support_high", "double3"),
        Value("support_radius", "double"),
        Value("ambient", "double"),
        Value("plane_point", "double3"),
        Value("plane_normal", "double3"),
        Value("length", "double"),
    ),
    "Control": (
        Value("face_low", "real3", "box in cells"),
        Value("face_high", "real3"),
        Value("radius", "real", "in cells"),
        Value("plane_normal", "real3", "per cell, so that plane_normal . cells - plane_offset is in metres"),
        Value("plane_offset", "real"),
        Value("plane_in_box", "int", "whether the plane comes near the box: else no step asks about it"),
        Value("cell_rate", "real3", "typical cells per metre, for limits on the step"),
        Value("step", "real", '"fixed": arc length; leapfrog: greatest distance of samples that step_bound holds for'),
        Value("step_limit", "real", "step in cells up to which step_bound is not asked"),
        Value("step_bound", "real*", "of each block, see step_bound.py; leapfrog: error per metre, see unresolved.py"),
        Value("step_bound_start", "int*", "where each cone's table starts in step_bound; -1 where it has none"),
        Value("block_count", "int3", "blocks along each local axis"),
        Value("block", "int", "cells in a block"),
        Value("tolerance", "real", "OPD error allowed for the whole ray"),
        Value("extent", "real", "a few diagonals of the box, longer than any step"),
        Value("max_steps", "int"),
        Value("quadrature_error_scale", "real", "leapfrog: the share of a difference that is taken for the error"),
        Value("trajectory_error_scale", "real", "and that of int P^2 / w dt"),
        Value("sample_count", "int", "of a ray whose samples are even, a multiple of three"),
        Value("left_potential", "real", "greatest potential outside the support"),
        Value("left_slope", "real", "and its slope [1/m]"),
        Value("outputs", "int", "of a ray that are wanted, a bit each, see result.py"),
    ),
    # The undisturbed ray against the box and the stop; distances along the ray.
    "Interval": (
        Value("t_enter", "double", "where the first step begins"),
        Value("t_exit", "double", "where it leaves the box, or stops before that"),
        Value("stop_distance", "double"),
        Value("has_stop", "bool", "whether it ever gets to the stop"),
        Value("meets", "bool", "whether it meets the box before the stop"),
        Value("side", "real", "times this, the normal of the stop plane points away from where the ray starts"),
    ),
    # A ray at the stop.
    "Arrival": (
        Value("position", "double3"),
        Value("direction", "double3"),
        Value("optical_path", "double"),
        Value("opd", "double"),
        Value("arc_length", "double"),
        Value("flight", "double", "beyond the box"),
        Value("grazing", "double2", "what a ray that grazes its last surface lacks of it, and its cosine there"),
        Value("status", "int"),
    ),
    # How an error of the direction grows up to the stop.
    "StopGeometry": (
        Value("obliquity", "real", "of the stop"),
        Value("lever_arm", "real", "how far on the error grows"),
        Value("reach", "real", "the part of that in the box"),
        Value(
            "derating",
            "real",
            "share of the step bounds of step_bound.py, which know nothing of the distance to a far stop",
        ),
    ),
    # The next step.
    "Stride": (
        Value("h", "real", "to try [sigma]"),
        Value("safe", "real", "in smooth air"),
        Value("stand_off", "real", "distance to keep from faces, in cells"),
    ),
    # A line p + t d, prepared for intersections with the body's surface; d need not be a unit vector.
    "WallLine": (
        Value("first", "double", "planar: y of p; axisymmetric: square of the least distance from the axis"),
        Value("across", "double", "planar: dy; axisymmetric: dx^2 + dy^2"),
        Value("along", "double", "dz"),
        Value("z", "double", "of p"),
        Value("nearest", "double", "axisymmetric: t where it is nearest to the axis"),
        Value("height", "double", "z there"),
        Value("square", "double", "dy^2 + dz^2, of a planar line; in a volume dx^2 + dy^2 + dz^2"),
        Value("point", "double3", "volume: p"),
        Value("toward", "double3", "volume: d"),
        Value("right", "double3", "volume: unit vectors across d, right-handed with it"),
        Value("up", "double3"),
    ),
    # Where a line crosses a segment r1, z1, r2, z2 (planar: y instead of r), or a triangle.
    "Crossings": (
        Value("count", "int", "0, 1 or 2 crossings"),
        Value(
            "enters",
            "bool",
            "whether the first one leads into the body, which lies to the left of the segment, behind the triangle",
        ),
        Value("one", "double", "t of the first"),
        Value("two", "double", "and of the second, which leads the other way"),
    ),
    # Where a line meets the body's surface between two of its points.
    "WallMeeting": (
        Value("entry", "double", "where it first enters it, NEVER if it does not"),
        Value("exit", "double", "where it first leaves it"),
        Value("odd", "bool", "whether it crosses the surface an odd number of times"),
    ),
    # The outputs for each ray; arrays that are not requested have one row.
    "RayOutputs": (
        Value("position", "double3*"),
        Value("direction", "double3*"),
        Value("optical_path", "double*"),
        Value("opd", "double*"),
        Value("arc_length", "double*"),
        Value("step_error", "double*"),
        Value("step_count", "int*"),
        Value("evaluation_count", "int*"),
        Value("status", "int*"),
    ),
}


class Option(NamedTuple):
    """A compile option: one of several names, the first by default; or a number, with its default."""

    choices: tuple[str, ...] | int
    meaning: str


OPTIONS: dict[str, Option] = {
    "real_is_double": Option(0, "whether deviations are float64"),
    "geometry": Option(("volume", "planar", "axisymmetric"), "of the field"),
    "interpolation": Option(
        ("cubic", "linear", "monotone", "bilinear", "bilinear-barron", "idw"), "on a grid, then on a mesh"
    ),
    "method": Option(("adaptive", "straight", "fixed", "paper"), "how long steps are"),
    "stop": Option(("none", "plane", "arc"), "where rays end"),
    "on_mesh": Option(0, "whether samples are on a mesh"),
    "has_body": Option(0, "whether the field has a body"),
    "measured": Option(1, "whether the errors of steps are estimated; error control needs them"),
    "lanes": Option(1, "rays that a work-item of leapfrog samples moves in step"),
    "packets": Option(1, "packets of so many rays that it moves in turns"),
    "packed": Option(0, "whether coefficients are the polynomials of cells, for leapfrog samples in two dimensions"),
    "cubes": Option(0, "whether coefficients are the polynomials of cubes of cells, for leapfrog samples in a volume"),
    "in_plane": Option(0, "whether all rays of leapfrog samples run along z, in a field of two dimensions"),
    "channels": Option(8, "how many numbers are interpolated between traced rays"),
}


def arrays_of(struct: str) -> tuple[Value, ...]:
    """Return the members of a struct that are arrays."""
    return tuple(member for member in STRUCTS[struct] if member.kind.endswith("*"))


def values_of(struct: str) -> tuple[Value, ...]:
    """Return the members of a struct that are numbers or vectors."""
    return tuple(member for member in STRUCTS[struct] if not member.kind.endswith("*"))
