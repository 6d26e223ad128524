"""What some rays of a run bring, and signed differences of it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Rays:
    """What rays bring to their stop, or a difference of that between two runs.

    Attributes:
        opd: Optical path difference [m], shape (n,).
        direction: Unit tangent there, shape (n, 3).
        position: Where the ray meets the stop [m], shape (n, 3).
    """

    opd: np.ndarray
    direction: np.ndarray
    position: np.ndarray

    @classmethod
    def still(cls, count: int) -> "Rays":
        """The difference of two equal runs."""
        return cls(np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)))

    def __add__(self, other: "Rays") -> "Rays":
        """Return the sum of both."""
        return self._with(other, np.add)

    def __sub__(self, other: "Rays") -> "Rays":
        """Return the difference of both."""
        return self._with(other, np.subtract)

    def __mul__(self, factor: float | np.ndarray) -> "Rays":
        """Return everything times a number, or each ray times its own, shape (n,)."""
        return Rays(*((part.T * factor).T for part in (self.opd, self.direction, self.position)))

    def __getitem__(self, rows) -> "Rays":
        """Return some of the rays."""
        return Rays(self.opd[rows], self.direction[rows], self.position[rows])

    def lifted(self, piston: float) -> "Rays":
        """Return the rays with a length added to every path [m]."""
        return Rays(self.opd + piston, self.direction, self.position)

    def _with(self, other: "Rays", call: Callable) -> "Rays":
        pairs = ((self.opd, other.opd), (self.direction, other.direction), (self.position, other.position))
        return Rays(*(call(one, two) for one, two in pairs))


@dataclass(frozen=True, eq=False)
class Cause:
    """How the rays change by one cause of an error.

    Attributes:
        known: Signed changes to what is right, of these rays; each counts by itself.
        like: Signed changes that are like those to what is right.
        draws: Equally likely changes, of which one is real.
    """

    known: tuple[Rays, ...] = ()
    like: tuple[Rays, ...] = ()
    draws: tuple[Rays, ...] = ()
