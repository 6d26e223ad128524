"""The structs and compile options of the kernels, which both engines read from these tables.

warp/library.py makes Warp's structs from them, and opencl/program.py the OpenCL headers types.h and options.h.

A kind is a type of OpenCL C: int, uint, bool, real (of the kernel's precision) or double, or a vector of 2 to 4 such
numbers; one star makes it an array in device memory, two stars an array with two indices. Structs are kinds, too.

Positions inside kernels are in cells: a whole part `cell` and a fraction `frac` along each of x, y, z, so that a lookup
rounds relative to the size of a cell and not of the box. Axes without cells of their own (x and y of an axisymmetric
field, all axes of a mesh) have cell = 0.
"""

import re
from functools import cache
from typing import NamedTuple

import numpy as np

REAL_TYPES: dict[str, type] = {"float32": np.float32, "float64": np.float64}


_KIND = re.compile(r"([A-Za-z]+)(\d?)(\**)")


class Value(NamedTuple):
    """A member of a struct."""

    name: str
    kind: str
    meaning: str = ""


@cache
def parts_of(kind: str) -> tuple[str, int, int]:
    """Return the type of one number or struct, the length of a vector (1 for a scalar), and the number of indices."""
    found = _KIND.fullmatch(kind)
    if found is None:
        raise ValueError(f"{kind!r} is not a kind, see layout.py")
    return found[1], int(found[2] or 1), len(found[3])


@cache
def number_type(kind: str, precision: str = "float64") -> type:
    """Return the NumPy type of the numbers of a kind."""
    plain = {"int": np.int32, "uint": np.uint32, "bool": np.int32, "double": np.float64}
    return {**plain, "real": REAL_TYPES[precision]}[parts_of(kind)[0]]


# Members in order; lengths are in metres unless the meaning says otherwise.
STRUCTS: dict[str, tuple[Value, ...]] = {
    "Field": (
        Value("coefficients", "real*", "uniform grid: of the potential, see medium/spline.py, flat"),
        Value("row", "int3", "greatest cell number along each local axis, for clamping"),
        Value("pitch", "int3", "distance in the flat array between neighbours along each local axis"),
        Value("inverse_spacing", "real3", "cells per metre along x, y, z"),
        Value("ambient", "real"),
        Value("corners", "real2*", "mesh: four corners of each cell"),
        Value("values", "real*", "mesh: contrast at those corners"),
        Value("gradients", "real2*", "mesh: node gradients at those corners"),
        Value("neighbors", "int*", "mesh: cell behind each edge of each cell, or -1"),
        Value("kinks", "real*", "mesh: jump of the potential's slope at each edge of each cell [1/m]"),
        Value("mesh_low", "real2", "bounding box of the mesh"),
        Value("mesh_high", "real2"),
        Value("bin_start", "int*"),
        Value("bin_cell", "int*"),
        Value("bin_count", "int2"),
        Value("bin_origin", "real2"),
        Value("bin_rate", "real2", "bins per metre"),
        Value("edge_tolerance", "real", "distance within which a point beside a cell counts as inside"),
        Value("cell_count", "int", "of the mesh"),
        Value("paper_step", "real*", "eq 5 for each cell"),
        Value("wall", "double4*", "segments or triangles of the body's surface, see medium/bodies/wall_tree.py"),
        Value("wall_normals", "double4*", "outward normals at their corners, linear between them"),
        Value("wall_boxes", "double4*", "boxes around groups of them"),
        Value("wall_links", "int3*", "of each box: next box if missed, first and last piece"),
        Value("wall_count", "int", "number of boxes"),
    ),
    "Bounds": (
        Value("origin", "double3", "position of cell = 0, frac = 0"),
        Value("spacing", "double3", "metres per cell"),
        Value("low", "double3", "box"),
        Value("high", "double3"),
        Value("radius", "double", "of an axisymmetric box"),
        Value("support_low", "double3", "part of the box outside which the air is uniform"),
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
        Value("plane_in_box", "int", "whether the plane comes near the box; otherwise no step checks it"),
        Value("cell_rate", "real3", "typical cells per metre, for limits on the step"),
        Value("step", "real", '"fixed": arc length; leapfrog: sample spacing up to which step_bound is valid'),
        Value("step_limit", "real", "step in cells that is allowed whatever step_bound is"),
        Value("step_bound", "real*", "of each block, see step_bound.py; leapfrog: error per metre, see unresolved.py"),
        Value("step_bound_start", "int*", "where each cone's table starts in step_bound; -1 where it has none"),
        Value("block_count", "int3", "blocks along each local axis"),
        Value("block", "int", "cells in a block"),
        Value("tolerance", "real", "OPD error allowed for the whole ray"),
        Value("extent", "real", "a few diagonals of the box, longer than any step"),
        Value("max_steps", "int"),
        Value("quadrature_error_scale", "real", "leapfrog: share of a difference that counts as the error"),
        Value("trajectory_error_scale", "real", "leapfrog: share of int P^2 / w dt that counts as the error"),
        Value("sample_count", "int", "leapfrog: samples of a ray, a multiple of three"),
        Value("steepest", "real3", "leapfrog: greatest components of unit vectors for which these samples suffice"),
        Value("left_potential", "real", "leapfrog: greatest potential outside the support"),
        Value("left_slope", "real", "leapfrog: greatest slope outside the support [1/m]"),
        Value("outputs", "int", "requested outputs of a ray, a bit each, see result.py"),
    ),
    # The undisturbed ray against the box and the stop; distances along the ray.
    "Interval": (
        Value("t_enter", "double", "where the first step begins"),
        Value("t_exit", "double", "where it leaves the box, or reaches the stop before"),
        Value("stop_distance", "double"),
        Value("has_stop", "bool", "whether it ever reaches the stop"),
        Value("meets", "bool", "whether it meets the box before the stop"),
        Value("normal", "double3", "outward, where the ray leaves the body in which it starts; zero for other rays"),
        Value("side", "real", "sign that turns the normal of the stop plane away from the ray's start"),
    ),
    # A ray at the stop.
    "Arrival": (
        Value("position", "double3"),
        Value("direction", "double3"),
        Value("optical_path", "double"),
        Value("opd", "double"),
        Value("arc_length", "double"),
        Value("flight", "double", "length of the path beyond the box"),
        Value("grazing", "double2", "if it grazes its last surface: length left to it; cosine there"),
        Value("status", "int"),
    ),
    # How an error of the direction grows up to the stop.
    "StopGeometry": (
        Value("obliquity", "real", "tangent of the angle of incidence on the stop"),
        Value("lever_arm", "real", "length over which the error grows"),
        Value("reach", "real", "part of that length in the box"),
        Value("derating", "real", "share of the step bounds, which do not allow for a far stop"),
        Value("resolution", "real", "rounding of a deflection at the stop, as a share of it"),
    ),
    # Errors of the steps of a ray by kinks at the edges of a mesh, as optical path [m]. Each is a vector: across the
    # ray by a wrong direction at the stop, along it by a wrong path. They have either sign: their sizes do not add.
    "Bends": (
        Value("x", "real", "components of the sum of the vectors"),
        Value("y", "real"),
        Value("z", "real"),
        Value("greatest", "real", "greatest sum of the first steps"),
        Value("root", "real", "root of the sum of their squares"),
        Value("sizes", "real", "sum of their sizes"),
    ),
    # The next step.
    "Stride": (
        Value("h", "real", "length to try [sigma]"),
        Value("safe", "real", "length up to which the air is smooth [sigma]"),
        Value("stand_off", "real", "distance to keep from faces, in cells"),
        Value("kinks", "real", "mesh: kinks at the edges that it crosses, the root of the sum of squares [1/m]"),
        Value("edge", "int", "mesh: number of the edge at which it ends, four to a cell; -1 if it ends at none"),
    ),
    # A line p + t d, prepared for intersections with the body's surface; d need not be a unit vector.
    "WallLine": (
        Value("first", "double", "planar: y of p; axisymmetric: square of the least distance from the axis"),
        Value("across", "double", "planar: dy; axisymmetric: dx^2 + dy^2"),
        Value("along", "double", "dz"),
        Value("z", "double", "of p"),
        Value("nearest", "double", "axisymmetric: t of the point nearest to the axis"),
        Value("height", "double", "z of that point"),
        Value("square", "double", "planar: dy^2 + dz^2; volume: dx^2 + dy^2 + dz^2"),
        Value("point", "double3", "volume: p"),
        Value("toward", "double3", "volume: d"),
        Value("right", "double3", "volume: unit vectors across d, right-handed with it"),
        Value("up", "double3"),
    ),
    # Where a line crosses a segment r1, z1, r2, z2 (planar: y instead of r), or a triangle.
    "Crossings": (
        Value("count", "int", "0, 1 or 2 crossings"),
        # The body is to the left of a segment, and behind a triangle.
        Value("enters", "bool", "whether the first crossing leads into the body"),
        Value("one", "double", "t of the first crossing"),
        Value("two", "double", "t of the second crossing, which leads the other way"),
    ),
    # Where a line meets the body's surface between two of its points.
    "WallMeeting": (
        Value("entry", "double", "where it first enters the body, NEVER if it does not"),
        Value("exit", "double", "where it first leaves the body, NEVER if it does not"),
        Value("piece", "int", "the piece of the surface through which it first leaves the body"),
        Value("odd", "bool", "whether it crosses the surface an odd number of times"),
    ),
    # A line through the box of a bundle, see deliver_bundle.py.
    "BoxCrossing": (
        Value("enter", "double", "distance at which it enters the box [m]"),
        Value("leave", "double"),
        Value("entry_face", "int", "-1 if it never enters"),
        Value("exit_face", "int"),
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
    "geometry": Option(("volume", "planar", "axisymmetric"), "geometry of the field"),
    "interpolation": Option(
        ("cubic", "linear", "monotone", "bilinear", "bilinear-barron", "idw"),
        "interpolation of the field, three on a grid and three on a mesh",
    ),
    "method": Option(("adaptive", "straight", "fixed", "paper"), "method that sets the length of steps"),
    "stop": Option(("none", "plane", "arc"), "where rays end"),
    "on_mesh": Option(0, "whether samples are on a mesh"),
    "has_body": Option(0, "whether the field has a body"),
    "measured": Option(1, "whether the errors of steps are estimated; error control needs them"),
    "lanes": Option(1, "rays that a work-item moves in step, or lines or places of a grid"),
    "packets": Option(1, "leapfrog: packets of that many rays that a work-item interleaves"),
    "cubes": Option(0, "leapfrog, volume: whether coefficients are the polynomials of cubes of cells"),
    "channels": Option(8, "how many numbers are interpolated between traced rays"),
}


# Of each struct the members that are arrays, and those that are numbers or vectors.
ARRAYS = {name: [each for each in members if each.kind.endswith("*")] for name, members in STRUCTS.items()}
VALUES = {name: [each for each in members if not each.kind.endswith("*")] for name, members in STRUCTS.items()}
