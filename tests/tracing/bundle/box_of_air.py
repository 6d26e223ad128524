"""Random air in a box, for parts of bundles."""

import numpy as np

from aerokernels import IndexField
from aerokernels.medium import Body

UP = np.array([0.0, 0.0, 1.0])


def field_of(geometry: str = "volume", interpolation: str = "cubic", body: Body | None = None) -> IndexField:
    """Random air in a box of 2 by 3 by 4 m, or r up to 3 m; cells of 0.2, 0.25 and 0.4 m."""
    axes = [0, 1, 2] if geometry == "volume" else [1, 2]
    samples = 1e-3 * np.random.default_rng(91).normal(size=[(11, 13, 11)[k] for k in axes])
    origin = [0.0 if geometry == "axisymmetric" and k == 1 else (-1.0, -1.0, 0.5)[k] for k in axes]
    return IndexField.from_samples(
        samples, origin=origin, spacing=[(0.2, 0.25, 0.4)[k] for k in axes], geometry=geometry,
        interpolation=interpolation, body=body,
    )  # fmt: skip
