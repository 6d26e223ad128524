// Scrambled Sobol points in two dimensions: bit reversal for the first axis and the sequence of x + 1 for the second,
// with a nested uniform scramble by hashing (B. Burley, Practical hash-based Owen scrambling, JCGT 9-4 (2020)).
// Coordinates are 32-bit fractions of 1; sums and products wrap around.
#ifndef SOBOL_H
#define SOBOL_H

#include "constants.h"

// The 32 bits of x in reverse order.
uint reverse_bits(uint x)
{
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0F0F0F0Fu) | ((x & 0x0F0F0F0Fu) << 4);
    x = ((x >> 8) & 0x00FF00FFu) | ((x & 0x00FF00FFu) << 8);
    return (x >> 16) | (x << 16);
}

// Nested uniform scramble of a fraction.
uint scramble(uint x, uint seed)
{
    x = reverse_bits(x);
    x += seed;
    x ^= x * HASH_1;
    x ^= x * HASH_2;
    x ^= x * HASH_3;
    x ^= x * HASH_4;
    return reverse_bits(x);
}

// Second coordinate of point `index`; the first is reverse_bits(index).
uint second_axis(uint index)
{
    uint result = 0u;
    uint column = 0x80000000u;
    for (uint rest = index; rest != 0u; rest >>= 1) {
        if (rest & 1u) {
            result ^= column;
        }
        column ^= column >> 1;
    }
    return result;
}

#endif
