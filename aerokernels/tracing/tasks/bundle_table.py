"""The patches of a family as kernels read them: from a ray's parameters to a block, and to one of its cells.

CHANNELS are deviations from the undisturbed line, which alone are small and smooth: optical path difference [m];
direction (3); end point [m] (3); arc length [m]. They are smooth only over lines through the same faces of the box.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.derived import Derived
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing.lines import FACES, SIDE, BoxSpan, box_span
from aerokernels.tracing.status import RayStatus
from aerokernels.tracing.stop import stop_distance
from aerokernels.tracing.tasks.family import CLOSE, Family

# Numbers in the header of a block: parameters of its first node (2), cells per unit of each parameter (2), the class of
# its lines (nodes.FaceClasses), and the greatest step error [m], step count and evaluation count of its lines.
HEADER = 8


@dataclass(frozen=True, eq=False)
class FaceClasses:
    """Classify lines by those of FACES through which they enter and leave a field's box, and which matter, shape (7,).

    `margin` is the least distance [m] to any other face of the place where a line leaves: a deflected ray might use it.
    """

    field: IndexField
    until: Any
    matters: np.ndarray
    margin: float = 0.0

    @property
    def are_all_alike(self) -> bool:
        """Whether no face matters: rays end elsewhere, and enter and leave through uniform air."""
        return self.until is not None and not self.matters.any()

    def numbers(self, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The class of each line, shape (n,): lines of one class pass the same faces. Negative where that is unsure."""
        if self.are_all_alike:
            return np.zeros(len(position), dtype=np.int64)
        span = box_span(self.field, position, direction)
        count, close = len(FACES), CLOSE * float(np.min(self.field.spacing))
        # A line that begins in the box is like one that enters through the face behind it, if that does not matter.
        behind = span.face_behind
        enter = np.where(span.enter <= close, count, behind)
        enter = np.where((behind >= 0) & ~self.matters[behind], count + 1, enter)
        leaves, near = span.exit_face, self._is_near_edge(position, direction, span)
        if self.until is not None:
            leaves = np.where(self.matters[span.exit_face], span.exit_face, count)
            # A line that stops inside the box does not leave it.
            stop = stop_distance(position, direction, self.until)
            leaves = np.where(stop < span.leave - close, count + 1, leaves)
            near &= leaves <= count
        beside = -1 if self.until is None else (count + 2) * (count + 3)
        number = np.where(near, -1, (count + 2) * leaves + enter)
        return np.where(span.meets, number, beside)

    def _is_near_edge(self, position: np.ndarray, direction: np.ndarray, span: BoxSpan) -> np.ndarray:
        """Whether lines leave the box within `margin` of a face other than their exit face, shape (n,)."""
        low, high = self.field.box
        place = position + np.where(span.meets, np.minimum(span.leave, FAR), 0.0)[:, None] * direction
        depth = np.minimum(place - low, high - place)
        if self.field.geometry == "axisymmetric":
            depth[:, 0] = high[0] - np.hypot(place[:, 0], place[:, 1])
            depth[:, 1] = np.inf
        own = np.where(span.exit_face == SIDE, 0, span.exit_face // 2)
        depth[np.arange(len(own)), own] = np.inf
        return np.asarray(depth.min(axis=1) < self.margin)


@dataclass(frozen=True, eq=False)
class BundleTable(Derived):
    """The patches of a family that meet the tolerance, and how they were found.

    Attributes:
        family: The lines.
        classes: Their classes by faces.
        channels: How many of CHANNELS the patches have.
        map: Number of the block at each place of the parameter range, -1 where there is none, shape (mu, mv).
        header: HEADER numbers of each block, shape (block_count, 8).
        values: Value, slopes and mixed slope at the nodes of each block [per cell], shape (block_count, 5, 5, 4, c), in
            float32 where its rounding is negligible.
        traced: Number of traced lines.
        error: Greatest estimated OPD error of the patches [m].
        refused: Approximate number of rays that are not interpolated, by reason.
    """

    family: Family
    classes: FaceClasses
    channels: int
    map: np.ndarray
    header: np.ndarray
    values: np.ndarray
    traced: int
    error: float
    refused: dict[str, float]

    @cached_property
    def precision(self) -> str:
        """The precision of `values`."""
        return str(self.values.dtype)

    @property
    def rate(self) -> np.ndarray:
        """Places of the map per unit of each parameter, shape (2,)."""
        return np.asarray(self.map.shape / (self.family.high - self.family.low))


def map_of(shape: tuple[int, int], blocks: list[tuple[int, np.ndarray]]) -> np.ndarray:
    """The map of block numbers; `blocks` holds the width in places and the indices (n, 2) of each level's blocks."""
    made = np.full(shape, -1, np.int32)
    first = 0
    for stride, some in blocks:
        view = made.reshape(shape[0] // stride, stride, shape[1] // stride, stride)
        view[some[:, 0], :, some[:, 1], :] = (first + np.arange(len(some), dtype=np.int32))[:, None, None]
        first += len(some)
    return made


CHANNELS = 8
# Number of channels that the outputs need: for "opd" alone, and for "direction".
OPD, WITH_DIRECTION = 1, 4
# Outputs that are requested of the traced lines.
TRACED = frozenset(
    ("opd", "direction", "position", "arc_length", "step_error", "step_count", "evaluation_count", "optical_path")
)
# Replaces infinity in kernels.
FAR = 1e300
# (rays) -> per-ray arrays by name
Tracer = Callable[[RayBundle], dict[str, np.ndarray]]


def channels_of(outputs: frozenset) -> int:
    """Number of channels that these outputs need."""
    if outputs & {"position", "arc_length"}:
        return CHANNELS
    return WITH_DIRECTION if "direction" in outputs else OPD


def undisturbed_length(field: IndexField, position: np.ndarray, direction: np.ndarray, until) -> np.ndarray:
    """Lengths of undisturbed lines up to their stop [m], shape (n,)."""
    if until is None:
        return box_span(field, position, direction).leave
    return stop_distance(position, direction, until)


@dataclass(frozen=True, eq=False)
class Traced:
    """Traced lines: CHANNELS (n, 8), NaN if not OK; classes; step error [m], steps and evaluations (n, 3)."""

    values: np.ndarray
    line_class: np.ndarray
    costs: np.ndarray

    @classmethod
    def joined(cls, *parts: "Traced") -> "Traced":
        """The lines of some lists, one list after the other."""
        names = [entry.name for entry in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def trace_lines(family: Family, classes: FaceClasses, tracer: Tracer, parameters: np.ndarray) -> Traced:
    """Trace the lines with these parameters, shape (n, 2)."""
    position, direction = family.rays(parameters)
    arrays = tracer(RayBundle(position, direction))
    length = undisturbed_length(classes.field, position, direction, classes.until)
    values = np.full((len(position), CHANNELS), np.nan)
    line_class = classes.numbers(position, direction)
    good = (arrays["status"] == RayStatus.OK) & np.isfinite(length) & (line_class >= 0)
    values[good, 0] = arrays["opd"][good]
    values[good, 1:4] = (arrays["direction"] - direction)[good]
    values[good, 4:7] = (arrays["position"] - position)[good] - length[good, None] * direction[good]
    values[good, 7] = arrays["arc_length"][good] - length[good]
    costs = np.stack([arrays[name] for name in ("step_error", "step_count", "evaluation_count")], axis=1)
    return Traced(values, line_class, costs)
