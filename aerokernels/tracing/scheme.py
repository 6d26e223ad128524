"""The constants of the tracing scheme besides the Runge-Kutta pair of tableau.py: one source for every backend.

Warp imports them; OpenCL reads them from constants.h, which opencl/program.py generates, in the kernel's precision but
for those that it lists as double. Numbers that depend on the precision are mappings from its name.
"""

# The length of a step.
# Steps of up to this many cells are taken whatever the table of step bounds says (step_bound.py): four samples a step
# are then closer together than the support of a sample. Beyond the cells of a mesh, which has no table, no step is
# longer than the second number.
STEP_LIMIT = 2.0
MESH_STEP_LIMIT = 4.0
# Greatest tolerance [waves] for which the field's structure may be stepped over.
LAXEST = 0.3
# Shortest step, in cells, that error control may choose.
LEAST_STEP = 1e-4
# A cell face closer than this, in cells, counts as passed: no step is taken to it.
FACE_TOLERANCE = 1e-4
# Greatest distance before a face, in cells, at which a step across a cell of a piecewise smooth interpolant may stop.
GREATEST_STAND_OFF = 1e-3
# Where the slope jumps at the faces of cells: a face that is nearer than this, in cells, has been reached; the slope
# behind it is evaluated at this distance beyond it.
AT_FACE = {"float32": 1e-6, "float64": 1e-9}
# Rounding of a distance to the axis, as a share of it: four units in the last place.
RADIUS_NOISE = {"float32": 2.0**-22, "float64": 2.0**-51}

# The error of a step.
# The share of the remaining error budget that one step may use up, however short it is.
STEP_SHARE = 0.02
# Steps in cells from which down an error estimate may be taken for rounding.
NOISE_STEP = 0.5
# Rounding in the error estimate, in units in the last place: error control does not chase it.
NOISE = {"float32": 8.0 * 2.0**-24, "float64": 8.0 * 2.0**-53}
# Rounding of a ray's momentum over its whole path, as a share of its greatest: an error of direction at a far stop.
DIRECTION_NOISE = {"float32": 2.0**-23, "float64": 2.0**-52}
# Rounding of the angle at which an undisturbed ray meets a plane [rad], four units in the last place of its direction
# and of the plane's normal. Its share of that angle is the share of an optical path difference that is rounding.
INCIDENCE_NOISE = 2.0**-50
# The slope between nodes is a difference of rounded values: its rounding is this many times theirs, for each cell of
# the path. It does not average out over the steps of a ray that keeps its position within the cells it crosses.
SLOPE_NOISE = 0.5
# A direction error counts with at least this share of the field's length, in addition to the ray's own slope.
DIRECTION_SHARE = 0.01
# The obliquity at which the undisturbed ray meets its stop counts less the more the ray is deflected, up to this angle
# [rad].
OBLIQUITY_KEPT = 0.25
# Smallest ratio of a step's refined error to the embedded formula's error that is accepted: where the table of step
# bounds says that the field is smooth over the step (or the step stays in one cell of a linear field), and elsewhere.
# The limit grows with the deflection of the ray and is 1 from an angle of 1 / RATIO_GROWTH on.
LEAST_RATIO_SMOOTH = 0.02
LEAST_RATIO = 0.2
RATIO_GROWTH = 30.0
# Errors are multiplied by this before their components are squared: the squares of small errors would underflow.
MAGNIFIED = 2.0**40
# Replaces a divisor that may be 0.
TINY = {"float32": 1e-30, "float64": 1e-290}

# Steps through a mesh, where slopes jump at the edges of cells (kernels/edges.py).
# Greatest number of cells that a step crosses.
EDGES_PASSED = 64
# The momentum's error if the slope jumps somewhere in a step, as a share of the jump times the step: at most 0.23, 0.11
# in the mean square over all places. The optical path's, as a share of the jump times the step squared: at most 0.034.
KINK_SHARE, KINK_PATH = 0.3, 0.035
# The errors of steps over such jumps add up by chance. A ray has the greatest sum of its first steps as its error, and
# so many times the root of the sum of their squares.
BEND_SPREAD = 1.0
# How far before an edge a step stops, as a share of the force times the step squared: the parabola leaves out that the
# force changes over the step.
EDGE_STAND_OFF = 0.15
# Rounding of the place where a ray crosses an edge, as a share of the tolerance by which a cell is found.
EDGE_ROUNDING = 0.25

# Leapfrog samples.
# Greatest angle with the first direction for which leapfrog samples are valid [rad].
LEAPFROG_ANGLE = 0.05
# Greatest number of blocks, along any axis, between two lookups of the bound on structure between a ray's samples.
LOOKUP_STRIDE = 1.5
# This bound changes from cell to cell by at most this many times its size.
MISSED_SLOPE = 2.0
# Cells along a side of a cube that has one polynomial (cube_polynomials.py), and floats that hold such a polynomial.
CUBE_SIDE = 2
CUBE_ROW = 16
# The effect on a ray of the air outside the field's support counts as an error from this share of the tolerance on:
# a smaller effect is already allowed for by the choice of the support (support.py).
LEFT_SHARE = 0.5

# Weight of the momentum that the method "straight" neglects at the ray's deflection, as at the obliquity of its stop.
STRAIGHT_LEVER = 3.0

# Where a ray ends.
# Cosines of the angle with a surface's normal: above the first, the point where a ray meets the surface is solved for
# along the ray's first direction; above the second, the ray's obliquity counts in full.
LEAST_COSINE, STEEPEST_COSINE = 0.05, 0.002
# A ray that meets a surface at a smaller angle is moved on to it by no more than this, in cells: the residue of
# rounding.
GRAZING_TOLERANCE = 1e-2
# A ray that flies to a plane must approach it by more than this per metre, and so must its undisturbed ray: others are
# parallel to it. An undisturbed ray that meets a plane a thousand million times as far away as it is high above it
# leaves no digits for a difference of paths: a rounding error of its direction moves that point by a hundred heights.
LEAST_SLOPE = 1e-9
# Event location: the remaining distance to a surface is flown by the last step's parabola if it is below this share of
# that step, or below rounding of the ray's position, in cells (for the plane and the cylinder: times their distance
# from the origin).
EVENT_LOCATION_SHARE = 0.02
EVENT_LOCATION_NOISE = {"float32": 1e-5, "float64": 1e-13}
# The number of the "surface" at which a stop at a length of arc ends a ray; those of space are numbered from 0.
ARC_SURFACE = 100
# The number of the "surface" for a ray that flies on from where it left the field's support.
BEYOND_SUPPORT = 101
# Rounding must not end a ray that runs in a face: the ray is behind a surface when it is so by this many cells.
SURFACE_TOLERANCE = {"float32": 1e-9, "float64": 1e-10}
# Where a ray rises to a face at a smaller slope than this, in cells, rounding moves the place where it leaves by more
# than a cell, so the ray may stay inside. In float64 the tolerance above covers such rays.
LEAST_RISE = {"float32": 2.0**-22, "float64": 0.0}
# The flight of such a ray behind the face counts as an error from this share of the tolerance on.
TOLERANCE_COUNTED = 1e-3
# Share of a ray's path to the box by which the wall may be behind the box's face and still be met before it.
ENTRY_ROUNDING = 1e-9
# A step looks for the wall along chords that keep so close to it, in cells.
WALL_SAG = 1e-4
# A step that ends at most this far inside the body, in cells, is flown back along the tangent; others are repeated.
WALL_CLOSE = 1e-2
# Steps do not search for the wall while the ray stays this near to its undisturbed line, in cells, if everything that
# near to the line is clear of the body.
WALL_ASIDE = 0.5
# Square of the cosine with a triangle's normal above which a ray that leaves through it does not graze it.
GRAZING_SQUARE = 1e-4
# A wall counts if it is at most this far behind a step's start, in cells: the position is rounded between two steps.
WALL_BACK = 1e-5

# Number of mesh cells that a ray's lookup walks through, edge by edge, before it searches the bins.
WALK_LIMIT = 6

# The pupil of a million rays.
# Rays summed by one work-group or thread, before the groups of a replicate are joined:
# so many that those of a lattice of 144 rays are one group, whose sums need no joining.
GROUP = 256
# Rows of group sums that are joined to one at a time: all rows of a million rays are joined at once.
REDUCTION_WIDTH = 64
# Multipliers of the hash that scrambles Sobol points (Burley, Practical hash-based Owen scrambling, JCGT 9-4 (2020)).
HASHES = (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6)
