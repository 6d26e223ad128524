"""The constants of the tracing scheme, beside the Runge-Kutta pair of tableau.py: one source for every backend.

Warp takes them from here, OpenCL from the header constants.h that opencl/headers.py makes of them: floats in the
kernel's precision, but for those that headers.py names as double.
Numbers that depend on the precision are mappings from its name.
"""

# The length of a step.
# Steps up to this many cells are taken whatever the table of step bounds says (step_bound.py): four samples a step are
# then closer together than the support of a sample. On a mesh, which has no table, no step is longer.
STEP_LIMIT = 2.0
MESH_STEP_LIMIT = 4.0
# Greatest tolerance [waves] for which the field's structure may be stepped over.
LAXEST = 0.3
# Shortest step, in cells, that error control asks for.
LEAST_STEP = 1e-4
# Cell faces that a ray has passed but for rounding, or is about to pass in so little, in cells: not worth a step.
FACE_TOLERANCE = 1e-4
# Greatest distance before a face, in cells, at which a step across a cell of a piecewise smooth interpolant may stop.
GREATEST_STAND_OFF = 1e-3
# Where the slope jumps at the faces of cells: a face that is nearer than this, in cells, has been reached; the slope
# behind it is looked up so far beyond it.
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
# Rounding of a ray's momentum over its whole way, as a share of its greatest: an error of direction at a far stop.
DIRECTION_NOISE = {"float32": 2.0**-23, "float64": 2.0**-52}
# The slope between nodes is a difference of rounded values: so many times that for each cell of the way. It does not
# average out over the steps of a ray that keeps its place in the cells it crosses.
SLOPE_NOISE = 0.15
# A direction error counts with at least this share of the field's length, besides the ray's own slope.
DIRECTION_SHARE = 0.01
# The obliquity at which the undisturbed ray meets its stop counts less the more the ray is deflected, up to this angle
# [rad].
OBLIQUITY_KEPT = 0.25
# Least ratio of a step's refined error to that of the embedded formula that is believed: where the table of step
# bounds says that the field is smooth over the step (or the step stays in one cell of a linear field), and elsewhere.
# It grows with the deflection of the ray and is 1 from an angle of 1 / RATIO_GROWTH on.
LEAST_RATIO_SMOOTH = 0.02
LEAST_RATIO = 0.2
RATIO_GROWTH = 30.0
# Errors are multiplied by this before their components are squared: the squares of small ones would vanish.
MAGNIFIED = 2.0**40
# In place of a divisor that may be 0.
TINY = {"float32": 1e-30, "float64": 1e-290}

# Leapfrog samples.
# Greatest angle with the first direction for which they hold [rad].
LEAPFROG_ANGLE = 0.05
# Greatest number of blocks, along any axis, between two lookups of what lies between a ray's samples.
LOOKUP_STRIDE = 1.5
# What lies between them changes from cell to cell by at most this many times its size.
MISSED_SLOPE = 2.0
# Cells along a side of a cube that has one polynomial (cube_polynomials.py), and floats that hold such a polynomial.
CUBE_SIDE = 2
CUBE_ROW = 16
# What the air outside the field's support may do to a ray counts as an error from this share of the tolerance on: below
# it is what the support was chosen for (support.py).
LEFT_SHARE = 0.5

# Where a ray ends.
# Cosines of the angle with a surface's normal: above the first the place where a ray meets it is solved for along the
# ray's first direction; above the second its obliquity counts in full.
LEAST_COSINE, STEEPEST_COSINE = 0.05, 0.002
# A ray that meets a surface at a smaller angle is moved on to it by no more than this, in cells: what rounding leaves.
GRAZING_TOLERANCE = 1e-2
# A ray that flies on to a plane comes nearer to it by more than this a metre: what rounding leaves of a parallel one.
LEAST_SLOPE = 1e-15
# Event location: what is left to a surface is flown by the last step's parabola if it is below this share of that
# step, or below rounding of the ray's place, in cells (for the plane and the cylinder: times their distance from the
# origin).
EVENT_LOCATION_SHARE = 0.02
EVENT_LOCATION_NOISE = {"float32": 1e-5, "float64": 1e-13}
# The number of the "surface" at which a stop at a length of arc ends a ray; those of space are numbered from 0.
ARC_SURFACE = 100
# The same for a ray that flies on from where it left the field's support.
BEYOND_SUPPORT = 101
# A ray that runs in a face is not thrown out by rounding: it is behind a surface when it is so by this many cells.
SURFACE_TOLERANCE = {"float32": 1e-9, "float64": 1e-10}
# Where a ray rises to a face at a smaller slope than this, in cells, rounding moves the place where it leaves by more
# than a cell: it may as well stay inside. In float64 such rays are left to the tolerance above.
LEAST_RISE = {"float32": 2.0**-22, "float64": 0.0}
# From this share of that on, what such a ray may fly behind the face counts as an error.
TOLERANCE_COUNTED = 1e-3
# Share of a ray's way to the box by which the wall may lie behind the box's face and still be met before it.
ENTRY_ROUNDING = 1e-9
# A step looks for the wall along chords that keep so close to it, in cells.
WALL_SAG = 1e-4
# A step that ends so far inside the body at most, in cells, is flown back along the tangent; others are taken anew.
WALL_CLOSE = 1e-2
# Steps look for no wall while the ray keeps so near to its undisturbed line, in cells, if all that is as near to it is
# clear of the body.
WALL_ASIDE = 0.5
# Square of the cosine with a triangle's normal above which a ray that leaves through it does not graze it.
GRAZING_SQUARE = 1e-4
# A wall counts that lies so far behind a step's start, in cells: the place is rounded between two steps.
WALL_BACK = 1e-5

# Cells of a mesh that a ray's lookup walks through, edge by edge, before it asks the bins.
WALK_LIMIT = 6

# The pupil of a million rays.
# Rays summed by one work-group or thread, before the groups of a replicate are joined.
GROUP = 128
# Rows of such sums that are joined to one at a time: those of a million rays at once.
REDUCTION_WIDTH = 64
# Multipliers of the hash that scrambles Sobol points (Burley, Practical hash-based Owen scrambling, JCGT 9-4 (2020)).
HASHES = (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6)
