"""Device function: weights of the samples of nearly straight rays."""

import warp as wp


@wp.func
def quadrature_weight(k: int, count: int):
    """Weight of sample k of `count`: the end-corrected midpoint rule."""
    end = wp.min(k, count - 1 - k)
    weight = wp.float64(1.0)
    if end == 0:
        weight = wp.float64(13.0) / wp.float64(12.0)
    elif end == 1:
        weight = wp.float64(0.875)
    elif end == 2:
        weight = wp.float64(25.0) / wp.float64(24.0)
    return weight
