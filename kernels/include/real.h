// The precision of the deviations; ends of rays and sums over rays are double in either precision.
#ifndef REAL_H
#define REAL_H

#include "kinds.h"

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif

#if REAL_IS_DOUBLE
typedef double real;
typedef double2 real2;
typedef double3 real3;
typedef double4 real4;
typedef double8 real8;
#define convert_real3 convert_double3
#else
typedef float real;
typedef float2 real2;
typedef float3 real3;
typedef float4 real4;
typedef float8 real8;
#define convert_real3 convert_float3
#endif

// Marks a function that is called, not inlined. On a CPU this halves the compile time, and rays take no longer; on a
// GPU calls would cost registers, so there it is inlined. A long kernel only calls such a function, because PoCL
// compiles the kernel itself three times. INLINED marks a function that PoCL would call, where that costs more.
#if ON_PROCESSOR
#define APART static __attribute__((noinline))
#define INLINED static inline __attribute__((always_inline))
#else
#define APART static inline
#define INLINED static inline
#endif

// A number of this precision; the literal is read in double first.
#define R(literal) ((real)(literal))

// A vector member of a struct that the host fills.
#define VECTOR(a) ((real3)((a)[0], (a)[1], (a)[2]))
#define VECTOR64(a) ((double3)((a)[0], (a)[1], (a)[2]))

// Plain comparisons: fmin and fmax also handle NaN, which costs several instructions on a CPU.
static inline real lesser(real a, real b) { return a < b ? a : b; }
static inline real greater(real a, real b) { return a > b ? a : b; }
static inline real bounded(real x, real low, real high) { return lesser(greater(x, low), high); }
static inline double lesser64(double a, double b) { return a < b ? a : b; }
static inline double greater64(double a, double b) { return a > b ? a : b; }

// The built-in length() scales its argument to avoid overflow, which cannot occur here.
static inline double size64(double3 v) { return sqrt(dot(v, v)); }

// Component of a vector by number; if the number is a compile-time constant, this costs nothing.
static inline real pick(real3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }
static inline double pick64(double3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }
static inline int pick_int(int3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }
static inline double3 unit64(int axis) { return (double3)(axis == 0 ? 1.0 : 0.0, axis == 1 ? 1.0 : 0.0, axis == 2 ? 1.0 : 0.0); }

static inline real greatest(real3 v) { return greater(v.x, greater(v.y, v.z)); }

// A sample of the field is (s, ds/dx, ds/dy, ds/dz).
#define FORCE(sample) ((sample).yzw)

#endif
