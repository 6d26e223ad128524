"""Recognise rays that form a two-parameter family: parallel rays, and rays whose lines pass through one point.

The parameters are transverse coordinates [m], or slopes with respect to the family's axis. All rays must start in one
plane, in one point, or ahead of the field's box, where they may be shifted along their lines. A sample identifies a
family; every ray is checked again, within `Family.close`, when it is interpolated (kernels deliver_bundle).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.derived import Derived
from aerokernels.medium import IndexField
from aerokernels.medium.grid import UniformGrid
from aerokernels.rays import RayBundle, transverse_axes
from aerokernels.tracing.lines import FACES, SIDE, BoxSpan, box_span
from aerokernels.tracing.stop import ArcLength, stop_distance

# Replaces infinity in kernels.
FAR = 1e300
# Lines, and planes of starts, that differ by less than this fraction of a cell count as one: the rest is rounding.
CLOSE = 1e-6
# Directions that differ by no more than this are equal.
EQUAL = 4e-15
# Least cosine of the angle between a line and the axis of its family.
LEAST_COSINE = 0.3
# Decimal digits to which the frame is rounded, and parts to which the parameter range is rounded, so that another
# sample of the same rays yields the same family.
AXIS_DIGITS, NORMAL_DIGITS, PARTS = 2, 12, 64
ROUNDED = 8.0  # parts of the distance `close`
# Rays from which a family is found, and rays that are counted block by block.
SAMPLE, COUNTED = 1 << 13, 1 << 16
# Margin around the parameters of the sample, as a fraction of their range: the sample may lack the outermost rays.
ROOM = 0.01
GOLDEN = 0.6180339887498949
NO_PENCIL = "their lines are neither parallel nor meet in one point"


@dataclass(frozen=True, eq=False)
class Family:
    """A two-parameter family of lines."""

    converges: bool  # whether the lines pass through `origin`; otherwise they are parallel
    origin: np.ndarray  # that point, or one of the plane in which the parameters are measured [m]
    axes: np.ndarray  # unit vectors along both parameters and the lines or their axis; shape (3, 3)
    low: np.ndarray  # least parameters [m, or 1], shape (2,)
    high: np.ndarray  # greatest parameters, shape (2,)
    start_point: np.ndarray | None  # of the plane in which rays start [m]; None where they all start in `origin`
    start_normal: np.ndarray  # that plane's unit normal
    ahead: float  # rays that start up to this distance along the axis [m] may be shifted along their lines; -inf: none
    close: float  # distance within which two lines, or two starts, count as the same [m]

    def parameters(self, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Parameters of rays, both of shape (n, 3): shape (n, 2)."""
        if self.converges:
            along = direction @ self.axes.T
            return np.asarray(along[:, :2] / along[:, 2:])
        return np.asarray((position - self.origin) @ self.axes[:2].T)

    def rays(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts [m] and unit vectors of the lines with these parameters (n, 2), each of shape (n, 3)."""
        across = parameters @ self.axes[:2]
        if self.converges:
            direction = self.axes[2] + across
            direction /= np.linalg.norm(direction, axis=1)[:, None]
            place = np.broadcast_to(self.origin, across.shape)
        else:
            direction = np.broadcast_to(self.axes[2], across.shape)
            place = self.origin + across
        if self.start_point is not None:
            ahead = ((self.start_point - place) @ self.start_normal) / (direction @ self.start_normal)
            place = place + ahead[:, None] * direction
        return np.array(place), np.array(direction)

    def holds_for(self, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Which rays belong to the family, shape (n,)."""
        if self.converges:
            way = self.origin - position
            beside = way - np.einsum("ij,ij->i", way, direction)[:, None] * direction
            good = np.einsum("ij,ij->i", beside, beside) <= self.close**2
            good &= direction @ self.axes[2] >= LEAST_COSINE
        else:
            good = np.abs(direction - self.axes[2]).max(axis=1) <= EQUAL
        if self.start_point is None:
            starts = np.abs(position - self.origin).max(axis=1) <= self.close
        else:
            starts = np.abs((position - self.start_point) @ self.start_normal) <= self.close
        starts |= position @ self.axes[2] <= self.ahead
        return np.asarray(good & starts)


def some_rows(ray_count: int, most: int) -> np.ndarray:
    """Row numbers of up to `most` rays, spread over the bundle's order without following any of its periods."""
    if ray_count <= most:
        return np.arange(ray_count)
    rows = np.sort((np.modf(GOLDEN * np.arange(most))[0] * ray_count).astype(np.int64))
    return rows[np.diff(rows, prepend=-1) > 0]  # np.unique takes three times as long


def closeness(field: IndexField, limit: float = np.inf) -> float:
    """Distance within which two lines, or two starts, count as the same [m], at most CLOSE cells.

    A line moved by x changes its optical path by x times the contrast at its start and the change of its momentum
    across itself, up to sqrt(2 c / n) between air whose index differs by c. `limit` is the OPD error allowed to a ray
    [m].
    """
    close = CLOSE * float(np.min(field.spacing))
    if not isinstance(field.samples, UniformGrid):
        return close
    low, high = field.samples.extremes
    contrast = max(high, 0.0) - min(low, 0.0)
    change = contrast + np.sqrt(2.0 * field.ambient_index * contrast)
    # Part of the error limit that this difference may cost: see `closeness`.
    return min(close, 0.1 * limit / change) if change > 0.0 else close


def find_family(field: IndexField, rays: RayBundle, until, limit: float = np.inf) -> Family | str:
    """The family of the rays for an OPD error allowed to each [m], or a sentence that says why they form none."""
    close = closeness(field, limit)
    few = rays.pilot  # nearly always tell
    if not _are_parallel(few.direction) and _apex(few.position, few.direction, close) is None:
        return NO_PENCIL
    some = rays.rows(some_rows(rays.ray_count, SAMPLE))
    position, direction = some.position, some.direction
    parallel = _are_parallel(direction)
    if parallel:
        axis, origin = direction[0], np.zeros(3)
    else:
        axis = np.round(direction.mean(axis=0), AXIS_DIGITS) + 0.0  # no negative zero
        if not np.linalg.norm(axis) > 0.1:
            return "their directions have no common axis"
        axis = axis / np.linalg.norm(axis)
        apex = _apex(position, direction, close)
        if apex is None:
            return NO_PENCIL
        origin = _rounded_apex(apex, direction, axis, close)
    least = _least_of_box(field, axis)
    furthest = float((position @ axis).max())
    ahead = least if not isinstance(until, ArcLength) and np.isfinite(least) and furthest <= least else -np.inf
    point: np.ndarray | None
    if not parallel and np.abs(position - origin).max() <= close:
        point, normal = None, axis
    else:
        plane = _common_plane(position, axis, close)
        if plane is None and not np.isfinite(ahead):
            return "they start neither in one plane nor ahead of the field's box"
        point, normal = plane or (axis * min(least, float((position @ axis).min())), axis)
        if not parallel and abs((origin - point) @ normal) <= close:
            return "their apex is in the plane in which they start"
    axes = np.stack([*transverse_axes(axis), axis])
    family = Family(not parallel, origin, axes, np.zeros(2), np.zeros(2), point, normal, ahead, close)
    if not family.holds_for(position, direction).all():
        return "they spread over too wide an angle"
    parameters = family.parameters(position, direction)
    low, high = parameters.min(axis=0), parameters.max(axis=0)
    extent = high - low
    if not extent.max() > 0.0:
        return "they are one ray"
    extent = np.maximum(extent, 1e-3 * extent.max())
    part, room = 2.0 ** np.ceil(np.log2(extent / PARTS)), ROOM * extent
    return replace(family, low=np.floor((low - room) / part) * part, high=np.ceil((high + room) / part) * part)


def _are_parallel(direction: np.ndarray) -> bool:
    return bool(np.abs(direction - direction[0]).max() <= EQUAL)


def _apex(position: np.ndarray, direction: np.ndarray, close: float) -> np.ndarray | None:
    """The point through which all lines pass [m], by least squares unless all start there; None where there is none."""
    if np.abs(position - position[0]).max() == 0.0:
        return np.asarray(position[0])
    middle = position.mean(axis=0)
    p = position - middle
    matrix = len(p) * np.eye(3) - direction.T @ direction
    along = np.einsum("ij,ij->i", direction, p)
    found, *_ = np.linalg.lstsq(matrix, p.sum(axis=0) - direction.T @ along, rcond=1e-15)
    way = found - p
    beside = way - np.einsum("ij,ij->i", way, direction)[:, None] * direction
    if not np.einsum("ij,ij->i", beside, beside).max() <= (0.5 * close) ** 2:
        return None
    return np.asarray(middle + found)


def _rounded_apex(apex: np.ndarray, direction: np.ndarray, axis: np.ndarray, close: float) -> np.ndarray:
    """Round the apex so that no line moves by more than rounding; it may move farther along the axis than across it."""
    frame = np.stack([*transverse_axes(axis), axis])
    spread = float(np.abs(direction @ frame[:2].T).max())
    coarser = 2.0 ** np.floor(np.log2(1.0 / max(spread, 1e-6)))
    return np.asarray(_rounded(frame @ apex, close * np.array([1.0, 1.0, max(coarser, 1.0)])) @ frame)


def _common_plane(position: np.ndarray, axis: np.ndarray, close: float) -> tuple[np.ndarray, np.ndarray] | None:
    """A point and the unit normal of the plane in which all rays start; None where there is none."""
    # If the starts are on one line, several planes contain them, and the plane normal to the axis is taken.
    for is_fitted in (False, True):
        normal = axis
        if is_fitted:
            fitted = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)[2][-1]
            normal = np.round(fitted * np.copysign(1.0, fitted @ axis), NORMAL_DIGITS)
        height = position @ normal
        if np.ptp(height) <= close and normal @ axis >= 0.05:
            middle = _rounded(0.5 * (height.max() + height.min()), close)
            return middle * normal / (normal @ normal), np.array(normal)
    return None


def _rounded(value, close):
    return np.round(value * (ROUNDED / close)) / (ROUNDED / close)


def _least_of_box(field: IndexField, axis: np.ndarray) -> float:
    """Least coordinate of the box along a unit vector [m]; minus infinity where the box is unbounded that way."""
    low, high = field.box
    with np.errstate(invalid="ignore"):
        ends = np.where(axis == 0.0, 0.0, np.minimum(low * axis, high * axis))
    return float(ends.sum())


def counted_parameters(family: Family, rays: RayBundle) -> tuple[np.ndarray, float]:
    """Parameters of a sample of the rays, and the number of rays that each sampled ray represents."""
    rows = some_rows(rays.ray_count, COUNTED)
    some = rays.rows(rows)
    return family.parameters(some.position, some.direction), rays.ray_count / len(rows)


# Numbers in the header of a block: parameters of its first node (2), cells per unit of each parameter (2), the class of
# its lines (FaceClasses), and the greatest step error [m], step count and evaluation count of its lines.
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
    """The patches of a family that meet the tolerance, with `channels` of CHANNELS, and how they were found."""

    family: Family
    classes: FaceClasses
    channels: int
    map: np.ndarray  # number of the block at each place of the parameter range, -1 where there is none, shape (mu, mv)
    header: np.ndarray  # HEADER numbers of each block, shape (block_count, 8)
    values: (
        np.ndarray
    )  # value, slopes, mixed slope [per cell] at nodes, (block_count, 5, 5, 4, c); float32 if it suffices
    traced: int  # number of traced lines
    error: float  # greatest estimated OPD error of the patches [m]
    refused: dict[str, float]  # approximate number of rays that are not interpolated, by reason

    @cached_property
    def precision(self) -> str:
        """The precision of `values`."""
        return str(self.values.dtype)

    @property
    def rate(self) -> np.ndarray:
        """Places of the map per unit of each parameter, shape (2,)."""
        return np.asarray(self.map.shape / (self.family.high - self.family.low))
