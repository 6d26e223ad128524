"""Random air in a box, for parts of bundles."""

import numpy as np

from aerokernels import IndexField
from aerokernels.medium import Body
from tests.random_air import random_air

UP = np.array([0.0, 0.0, 1.0])


def field_of(geometry: str = "volume", interpolation: str = "cubic", body: Body | None = None) -> IndexField:
    """Random air in a box of 2 by 3 by 4 m, or r up to 3 m; cells of 0.2, 0.25 and 0.4 m."""
    return random_air(
        geometry, 91, lambda random, shape: 1e-3 * random.normal(size=shape), (11, 13, 11), (-1.0, -1.0, 0.5),
        (0.2, 0.25, 0.4), interpolation=interpolation, body=body,
    )  # fmt: skip
