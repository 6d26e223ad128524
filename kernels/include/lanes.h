// Vectors across rays: a packet of LANES neighbours moves in step, so that the lanes of a CPU are all in use. On a GPU,
// where LANES is 1, they are plain numbers.
#ifndef LANES_H
#define LANES_H

#include "real.h"

#if LANES == 1
typedef real reals;
typedef int ints;
typedef int mask;
#define TO_INTS(x) ((int)(x))
#define TO_REALS(x) ((real)(x))
#define TO_MASK(x) (x)
#define CHOOSE(other, value, where) ((where) ? (value) : (other))
#define EVERY(where) (where)
#elif REAL_IS_DOUBLE && LANES == 8
typedef double8 reals;
typedef int8 ints;
typedef long8 mask;
#define TO_INTS(x) convert_int8(x)
#define TO_REALS(x) convert_double8(x)
#define TO_MASK(x) convert_long8(x)
#elif !REAL_IS_DOUBLE && LANES == 16
typedef float16 reals;
typedef int16 ints;
typedef int16 mask;
#define TO_INTS(x) convert_int16(x)
#define TO_REALS(x) convert_float16(x)
#define TO_MASK(x) (x)
#else
#error LANES is 1, 16 in single or 8 in double precision
#endif

#if LANES > 1
// True is -1 in the lanes of a vector.
#define CHOOSE(other, value, where) select(other, value, TO_MASK(where))
#define EVERY(where) all(where)
#endif

// A GPU's own reciprocal and root, right to two units in the last place or so: enough for factors of what is itself a small
// deviation. Elsewhere, and in double precision, the exact ones.
#if LANES == 1 && !REAL_IS_DOUBLE
#define SWIFT_INVERSE(x) native_recip(x)
#define SWIFT_ROOT(x) native_sqrt(x)
#else
#define SWIFT_INVERSE(x) (R(1.0) / (x))
#define SWIFT_ROOT(x) sqrt(x)
#endif

#define REAL_AT(v, lane) (((real *)&(v))[lane])
#define VECTOR_AT(v, lane) ((real3)(REAL_AT((v)[0], lane), REAL_AT((v)[1], lane), REAL_AT((v)[2], lane)))
#define INT_AT(v, lane) (((int *)&(v))[lane])

#endif
