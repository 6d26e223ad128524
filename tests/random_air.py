"""Fields of random samples on a grid of any geometry."""

from collections.abc import Callable, Sequence

import numpy as np

from aerokernels.medium import IndexField


def random_air(
    geometry: str,
    seed: int,
    draw: Callable[[np.random.Generator, list[int]], np.ndarray],
    counts: Sequence[int],
    origin: Sequence[float],
    spacing: Sequence[float],
    **options,
) -> IndexField:
    """The field of samples that `draw` makes for a shape; what has three entries is along x, y, z.

    A planar field has no axis along x; in an axisymmetric one the axis y is that of r, which starts at 0.
    """
    axes = [0, 1, 2] if geometry == "volume" else [1, 2]
    samples = draw(np.random.default_rng(seed), [counts[axis] for axis in axes])
    first = [0.0 if geometry == "axisymmetric" and axis == 1 else origin[axis] for axis in axes]
    return IndexField.from_samples(
        samples, origin=first, spacing=[spacing[axis] for axis in axes], geometry=geometry, **options
    )
