// Vectors across rays: a packet of LANES neighbouring rays moves in step, which fills the vector lanes of a CPU. On a
// GPU, where LANES is 1, they are plain numbers.
#ifndef LANES_H
#define LANES_H

#include "real.h"

// One instruction of clang's: PoCL's own functions split a vector down to single numbers to convert it.
#define CONVERTED(x, type) __builtin_convertvector(x, type)

// Numbers of the kernel's precision, doubles, integers and truth values for each lane: `mask` of comparisons of reals,
// `truths` of comparisons of doubles.
#if LANES == 1
typedef real reals;
typedef double doubles;
typedef int ints;
typedef int mask;
typedef int truths;
#define TO_INTS(x) ((int)(x))
#define TO_REALS(x) ((real)(x))
#define TO_DOUBLES(x) ((double)(x))
#define TO_MASK(x) (x)
#define TO_TRUTHS(x) (x)
#define CHOOSE(other, value, where) ((where) ? (value) : (other))
#define CHOOSE64(other, value, where) ((where) ? (value) : (other))
#define SOME(where) (where)
#elif REAL_IS_DOUBLE && LANES == 8
typedef double8 reals;
typedef double8 doubles;
typedef int8 ints;
typedef long8 mask;
typedef long8 truths;
#define TO_INTS(x) CONVERTED(x, int8)
#define TO_REALS(x) CONVERTED(x, double8)
#define TO_DOUBLES(x) CONVERTED(x, double8)
#define TO_MASK(x) CONVERTED(x, long8)
#define TO_TRUTHS(x) CONVERTED(x, long8)
#elif !REAL_IS_DOUBLE && LANES == 16
typedef float16 reals;
typedef double16 doubles;
typedef int16 ints;
typedef int16 mask;
typedef long16 truths;
#define TO_INTS(x) CONVERTED(x, int16)
#define TO_REALS(x) CONVERTED(x, float16)
#define TO_DOUBLES(x) CONVERTED(x, double16)
#define TO_MASK(x) CONVERTED(x, int16)
#define TO_TRUTHS(x) CONVERTED(x, long16)
#else
#error LANES is 1, 16 in single or 8 in double precision
#endif

#if LANES > 1
// True is -1 in the lanes of a vector.
#define CHOOSE(other, value, where) select(other, value, TO_MASK(where))
#define CHOOSE64(other, value, where) select(other, value, where)
#define SOME(where) any(where)
#endif

// A GPU's own reciprocal and root, accurate to about two units in the last place: enough for factors of small
// deviations. On a CPU and in double precision, the correctly rounded ones.
#if LANES == 1 && !REAL_IS_DOUBLE
#define SWIFT_INVERSE(x) native_recip(x)
#define SWIFT_ROOT(x) native_sqrt(x)
#else
#define SWIFT_INVERSE(x) (R(1.0) / (x))
#define SWIFT_ROOT(x) sqrt(x)
#endif

#if LANES == 1
#define REAL_AT(v, lane) (v)
#define INT_AT(v, lane) (v)
#define DOUBLE_AT(v, lane) (v)
#define NUMBER_AT(v, lane) (v)
#else
#define REAL_AT(v, lane) (((real *)&(v))[lane])
#define INT_AT(v, lane) (((int *)&(v))[lane])
#define DOUBLE_AT(v, lane) (((double *)&(v))[lane])
#define NUMBER_AT(v, lane) (((long *)&(v))[lane])
#endif
#define TRUTH_AT(v, lane) (NUMBER_AT(v, lane) != 0)
#define TRIPLE_AT(v, lane) ((double3)(DOUBLE_AT((v).x, lane), DOUBLE_AT((v).y, lane), DOUBLE_AT((v).z, lane)))

#endif
