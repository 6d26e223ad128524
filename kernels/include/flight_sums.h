// The sums of nearly straight rays over their leapfrog samples, and the weights of the samples.
#ifndef FLIGHT_SUMS_H
#define FLIGHT_SUMS_H

#include "packet.h"

// Weight of sample k of `count`: the end-corrected midpoint rule.
static inline real quadrature_weight(int k, int count)
{
    const int end = min(k, count - 1 - k);
    return end == 0 ? R(13.0 / 12.0) : end == 1 ? R(7.0 / 8.0) : end == 2 ? R(25.0 / 24.0) : R(1.0);
}

// The weights of three consecutive samples, for six samples or more.
static inline void triple_weights(int triple, int triples, real *weights)
{
    const int is_first = triple == 0, is_last = triple == triples - 1;
    weights[0] = is_first ? R(13.0 / 12.0) : is_last ? R(25.0 / 24.0) : R(1.0);
    weights[1] = is_first || is_last ? R(7.0 / 8.0) : R(1.0);
    weights[2] = is_last ? R(13.0 / 12.0) : is_first ? R(25.0 / 24.0) : R(1.0);
}

#if defined(__AVX512F__) && defined(__has_builtin)
#if __has_builtin(__builtin_ia32_rsqrt14ps512_mask)
#define SWIFT_ROOTS 1
#endif
#endif

// (w - a) / w and 1 / w for w = sqrt(a^2 + surplus), with one root and one quotient and without cancellation.
static inline reals longitudinal_deficit_of(real ambient, reals surplus, reals *slowness)
{
    const reals square = max(ambient * ambient + surplus, (reals)TINY);
#if LANES == 1 && !REAL_IS_DOUBLE
    *slowness = native_rsqrt(square);
    const reals w = square * *slowness;
    return surplus * native_recip((w + ambient) * w);
#elif LANES == 16 && SWIFT_ROOTS
    // The next sample waits for the slowness, not for the deficit: take a table's inverse root, accurate to 2^-14, and
    // one Newton step.
    const reals rough = __builtin_ia32_rsqrt14ps512_mask(square, square, (unsigned short)0xffff);
    *slowness = rough * (R(1.5) - R(0.5) * square * rough * rough);
    const reals w = square * *slowness;
    return surplus * *slowness / (w + ambient);
#else
    const reals w = sqrt(square);
    const reals quotient = R(1.0) / ((w + ambient) * w);
    *slowness = (w + ambient) * quotient;
    return surplus * quotient;
#endif
}

// Add a term to Kahan's compensated sum.
static inline void gather(reals *total, reals *carry, reals term)
{
    const reals y = term - *carry;
    const reals s = *total + y;
    *carry = (s - *total) - y;
    *total = s;
}

#endif
