"""The light of a source's points, traced one after another: only what a picture keeps of it is in memory."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from aerokernels.medium import IndexField

from .line_of_sight import LineOfSight, ParallelLight, line_of_sight


class SourceLight:
    """The light of a source's points through a field; iterating traces it, point by point.

    Attributes:
        lights: The light of each point that was traced.
        known: Pixels whose light is known for all of these points, shape (ny, nx).
        middle: The rays of the source's middlemost point, once they are traced.
    """

    def __init__(self, field: IndexField, tilts: np.ndarray, focus: float, options: dict[str, Any]):
        """Take the points' angles toward right and up [rad], shape (n, 2), and options of `line_of_sight`."""
        self.field, self.tilts, self.options = field, tilts, {**options, "focus": focus}
        self.lights: list[ParallelLight | None] = []
        self.known: np.ndarray | None = None
        self.middle: LineOfSight | None = None

    def __iter__(self) -> Iterator[LineOfSight]:
        """Trace the light of each point."""
        middle = int(np.argmin(np.hypot(*self.tilts.T)))
        for number, (right, up) in enumerate(self.tilts):
            traced = line_of_sight(self.field, tilt=(right, up), **self.options)
            self.lights.append(traced.light)
            self.known = traced.known if self.known is None else self.known & traced.known
            if number == middle:
                self.middle = traced
            yield traced
