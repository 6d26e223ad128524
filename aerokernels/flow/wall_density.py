"""A solver's densities at the walls of a flow on a mesh, in addition to the averages over its cells."""

from dataclasses import dataclass, replace

import numpy as np

from .gas import no_gas


@dataclass(frozen=True, eq=False)
class WallDensity:
    """Densities at points of walls: at the ends and the midpoints of the cells' edges.

    Attributes:
        points: Positions (y, z) or (r, z) [m], shape (n, 2).
        density: [kg/m3], shape (n,).

    Raises:
        ValueError: Arrays of other shapes, or densities that no gas has.
    """

    points: np.ndarray
    density: np.ndarray

    def __post_init__(self):
        """Check the densities."""
        points, density = np.array(self.points, dtype=np.float64), np.array(self.density, dtype=np.float64)
        if density.ndim != 1 or points.shape != (len(density), 2):
            raise ValueError(f"walls have points of shape (n, 2) and n densities, got {points.shape}, {density.shape}")
        if wrong := no_gas(density):
            raise ValueError(f"{wrong[1]} of {len(density)} densities at walls are {wrong[0]}: repair the flow file")
        for name, values in (("points", points), ("density", density)):
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def scaled(self, ratio: float) -> "WallDensity":
        """Return the wall densities multiplied by a ratio."""
        return replace(self, density=self.density * ratio)
