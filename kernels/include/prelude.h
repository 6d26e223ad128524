// What generated kernels need besides real.h: sums in Warp's order, floors, picks by a number that varies.
#ifndef PRELUDE_H
#define PRELUDE_H

// For tests: without fused operations the results are those of Warp's kernels on a CPU, bit for bit.
#ifdef STRICT
#pragma OPENCL FP_CONTRACT OFF
#endif

#include "types.h"
#include "constants.h"
#include "ray_status.h"

// A device's own dot may add in another order.
static inline real dot2(real2 a, real2 b) { return a.x * b.x + a.y * b.y; }
static inline real dot3(real3 a, real3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline real dot4(real4 a, real4 b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }
static inline double dot2_64(double2 a, double2 b) { return a.x * b.x + a.y * b.y; }
static inline double dot3_64(double3 a, double3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline real norm2(real2 v) { return sqrt(dot2(v, v)); }
static inline real norm3(real3 v) { return sqrt(dot3(v, v)); }
static inline double norm2_64(double2 v) { return sqrt(dot2_64(v, v)); }
static inline double norm3_64(double3 v) { return sqrt(dot3_64(v, v)); }

static inline double3 normalized64(double3 v)
{
    const double length = norm3_64(v);
    return length > 0.0 ? v / length : (double3)(0.0);
}

// Whole part below a number; the built-in floor takes several times as long.
static inline int floor_of(real x) { const int whole = (int)x; return whole - (x < (real)whole); }
static inline int floor64(double x) { const int whole = (int)x; return whole - (x < (double)whole); }

static inline double bounded64(double x, double low, double high) { return lesser64(greater64(x, low), high); }
static inline real pick4(real4 v, int k) { return k == 0 ? v.x : k == 1 ? v.y : k == 2 ? v.z : v.w; }
static inline double pick4_64(double4 v, int k) { return k == 0 ? v.x : k == 1 ? v.y : k == 2 ? v.z : v.w; }

// Add a term to Kahan's compensated sum.
static inline void advance3(real3 *total, real3 *carry, real3 term)
{
    const real3 y = term - *carry;
    const real3 s = *total + y;
    *carry = (s - *total) - y;
    *total = s;
}

static inline void advance4(real4 *total, real4 *carry, real4 term)
{
    const real4 y = term - *carry;
    const real4 s = *total + y;
    *carry = (s - *total) - y;
    *total = s;
}

#endif
