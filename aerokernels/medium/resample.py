"""Resample any field to a uniform grid, and measure the error.

Nodes inside the body continue the flow's values across the wall, so that the interpolant has no jump there. The error
is measured at scattered points of the flow, and in optical path along lines parallel to the last axis (z). That of a
trace's rays depends on the rays: budgets send some through the original field, which the result stores.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from aerokernels.derived import cached_on
from aerokernels.inputs.checks import check_positive
from aerokernels.inputs.kinds import are_numbers
from aerokernels.medium.grid import UniformGrid
from aerokernels.medium.mesh import QuadMesh
from aerokernels.process.machine import host_memory
from aerokernels.sobol import sobol_points

LINE_COUNT = 64
# Most nodes of a grid whose geometry is cached on the mesh that was resampled last: 100 bytes each, and 10 MB.
KEPT_NODES = 1 << 18  # speed only
NODE_LIMIT = 200_000_000
# A grid of fewer cells along an axis does not resolve any structure of a flow.
LEAST_CELLS = 4


@dataclass(frozen=True)
class ResamplingError:
    """Measured errors of resampling.

    Attributes:
        spacing: Node spacing of the uniform grid [m], one per axis.
        contrast_rms: Root mean square change of the contrast in the flow.
        contrast_max: Greatest observed change of the contrast.
        opd_rms: Root mean square change of the optical path along lines parallel to z [m].
        opd_max: Greatest change of the optical path along those lines [m].
        direction_rms: Root mean square change of the deflection along those lines [rad].
        source: The original field; None where it is not stored, in which case budgets are not known.
    """

    spacing: tuple[float, ...]
    contrast_rms: float
    contrast_max: float
    opd_rms: float
    opd_max: float
    direction_rms: float
    source: Any = field(default=None, repr=False, compare=False)


def resample(field, spacing=None, *, tolerance=None, wavelength=None, region=None, interpolation="cubic"):
    """Resample a field to a uniform grid: see `IndexField.resample`."""
    wavelength = field.wavelength_for(wavelength)
    if (spacing is None) == (tolerance is None):
        raise ValueError("give either spacing [m] or tolerance [waves]")
    low, high = (np.array(v) for v in _region(field, region))
    dimension = len(low)
    if spacing is not None:
        step = np.asarray(spacing, dtype=np.float64)
        if step.shape not in ((), (dimension,)):
            raise ValueError(f"spacing must be one number or {dimension}, one for each axis [m], got {spacing!r}")
        step = np.broadcast_to(step, (dimension,))
        if not (np.isfinite(step).all() and (step > 0).all()):
            raise ValueError(f"spacing must be positive, got {spacing!r}")
        node_counts(field, low, high, step)  # reject a useless grid before anything is computed
        return _resample_once(field, low, high, step, interpolation)
    check_positive(tolerance, "tolerance", "waves")
    step, before = np.minimum(field.spacing * 2.0, (high - low) / 8.0), None
    while True:
        result = _resample_once(field, low, high, step, interpolation)
        error = result.resampling.opd_max
        if error <= tolerance * wavelength:
            return result
        # By the spline's order a halving reduces the error 16-fold, 64-fold at most. If the last one reduced it less,
        # each of the next does so at most by the square of that, but by no less than 4, the order at kinks.
        gain = 64.0 if before is None else min(max((before / error) ** 2, 4.0), 64.0)
        halvings = max(1, int(np.ceil(np.log(error / (tolerance * wavelength)) / np.log(gain) - 1e-9)))
        if np.prod((high - low) / (0.5**halvings * step) + 1.0) > NODE_LIMIT / 4:
            raise ValueError(
                f"a spacing of {step.max():.3g} m still changes the optical path by {error / wavelength:.3g} waves, "
                f"more than the tolerance of {tolerance:g}: give a greater tolerance or a smaller region; no grid of "
                "allowed size meets this one"
            )
        # Steps above the field's own spacing do not show how fast the error decreases below it.
        step, before = 0.5 * step, error if (step <= field.spacing * (1.0 + 1e-9)).all() else None


def _region(field, region):
    low, high = field.samples.low, field.samples.high
    if region is None:
        return low, high
    try:
        first, last = (np.asarray(corner if are_numbers(corner) else None, dtype=np.float64) for corner in region)
    except (TypeError, ValueError):
        raise ValueError(f"region needs two corners of {len(low)} coordinates each [m], got {region!r}") from None
    if first.shape != low.shape or last.shape != low.shape:
        raise ValueError(f"region needs two corners of {len(low)} coordinates each, got {region!r}")
    if field.geometry == "axisymmetric" and first[0] != 0.0:
        raise ValueError(f"the region of an axisymmetric field starts at r = 0, got {first[0]!r}")
    finite = np.isfinite(first).all() and np.isfinite(last).all()
    if not (finite and (last > first).all() and (first < high).all() and (last > low).all()):
        raise ValueError(f"region {region!r} does not overlap the field's box {low.tolist()} to {high.tolist()}")
    return first, last


def _resample_once(field, low, high, step, interpolation):
    count = node_counts(field, low, high, step)
    # The region is divided evenly: nodes beyond it would sample ambient air, which is a jump at the face.
    step = (high - low) / (count - 1)
    step = step + 2.0 * np.maximum(high - (low + step * (count - 1)), 0.0) / (count - 1)
    points = _points(field, low, high, step, count)
    contrast = points.nodes.contrast(field)
    if len(points.inside):  # extrapolated into the body
        skin, ahead = points.skin.contrast(field), points.ahead.contrast(field)
        contrast[points.inside] = skin + (skin - ahead) * points.fade
    even = field.geometry == "axisymmetric"
    grid = UniformGrid(contrast.reshape(count), low, step, interpolation, even, field.ambient_index)
    product, upstream = field.upstream, field.upstream
    if product is not None and product.group is not None and product.group.field is not None:
        again = partial(_resampled, product.group.field, step, (low, high), interpolation)
        upstream = replace(product, group=replace(product.group, field=again))
    result = replace(field, samples=grid, resampling=None, upstream=upstream)
    return replace(result, resampling=_measure(field, result, points))


def _resampled(make, step, region, interpolation):
    return make().resample(step, region=region, interpolation=interpolation)


@dataclass(frozen=True, eq=False)
class _PointSet:
    """Points at which a field is evaluated: the rows among all of them that are; elsewhere the result is zero."""

    count: int
    rows: np.ndarray
    points: np.ndarray  # of these rows, local coordinates [m]
    places: Any  # the cells of these points, for a field on a mesh

    def contrast(self, field) -> np.ndarray:
        """Return the contrast, shape (count,)."""
        result = np.zeros(self.count)
        result[self.rows] = self.evaluate(field, with_gradient=False)[0]
        return result

    def evaluate(self, field, with_gradient: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Return the contrast and its gradient [1/m] at the points `rows`; zero outside the field's box."""
        if not field.is_uniform:
            return field.samples.evaluate(self.points, self.places, with_gradient)
        value, gradient = field.samples.evaluate(self.points)
        outside = ~np.all((self.points >= field.samples.low) & (self.points <= field.samples.high), axis=1)
        value[outside], gradient[outside] = 0.0, 0.0
        return value, gradient


@dataclass(frozen=True, eq=False)
class _ResamplingPoints:
    """The points at which resampling evaluates a field; they do not depend on the field's values."""

    nodes: _PointSet  # of the grid
    inside: np.ndarray  # indices of the nodes inside the body
    skin: _PointSet  # points at the wall nearest to these nodes
    ahead: _PointSet  # these nodes mirrored at the wall, at most two spacings from it
    fade: np.ndarray  # fraction of the slope at the wall with which each of these nodes is extrapolated
    probe: _PointSet  # scattered points of the flow
    lines: _PointSet  # points along lines parallel to the last axis, LINE_COUNT times `line_points`
    line_points: int
    length: float  # of the line that each point represents [m]


def _points(field, low: np.ndarray, high: np.ndarray, step: np.ndarray, count: np.ndarray) -> _ResamplingPoints:
    """Return the points for a grid; the last ones are cached on a mesh, for fields of other values on it."""
    if field.is_uniform:
        return _make_points.function(field.samples, field.body, low, high, step, count)
    make = _make_points.function if np.prod(count) > KEPT_NODES else _make_points
    return make(field.samples.mesh, field.body, low, high, step, count)


@cached_on("where")
def _make_points(where: QuadMesh | UniformGrid, body, low, high, step, count) -> _ResamplingPoints:
    is_mesh = isinstance(where, QuadMesh)
    dimension, box = len(low), where.box if is_mesh else (where.low, where.high)

    def point_set(points: np.ndarray, kept: np.ndarray) -> _PointSet:
        rows = np.flatnonzero(kept)
        places = where.places(points[rows]) if isinstance(where, QuadMesh) else None
        return _PointSet(len(points), rows, points[rows], places)

    def within(points: np.ndarray) -> _PointSet:
        return point_set(points, np.all((points >= box[0]) & (points <= box[1]), axis=1))

    def flowing(points: np.ndarray) -> _PointSet:
        return point_set(points, np.ones(len(points), bool) if body is None else ~body.contains(points))

    axes = [np.minimum(low[k] + step[k] * np.arange(count[k]), high[k]) for k in range(dimension)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
    inside = np.zeros(0, int) if body is None else np.flatnonzero(body.contains(nodes))
    foot = nodes[inside] if body is None else body.nearest_wall(nodes[inside])
    out = foot - nodes[inside]
    depth = np.linalg.norm(out, axis=1)
    # A node exactly on the wall has no outward direction, and needs none: its own value is valid.
    normal = out / np.where(depth > 0.0, depth, 1.0)[:, None]
    reach = float(step.min())
    mirrored = np.minimum(depth, 2.0 * reach)

    grid_high = low + step * (count - 1)
    extent = np.where(high > box[1], grid_high, np.minimum(box[1], grid_high)) - low
    line_points = min(8192, max(256, int(4 * np.max(extent[-1] / step[-1]))))
    across = low[:-1] + extent[:-1] * sobol_points(LINE_COUNT, dimension - 1, seed=2)
    along = low[-1] + extent[-1] * (np.arange(line_points) + 0.5) / line_points
    lines = np.concatenate([np.repeat(across, line_points, axis=0), np.tile(along, LINE_COUNT)[:, None]], axis=1)
    return _ResamplingPoints(
        within(nodes),
        inside,
        within(foot + 1e-3 * reach * normal),
        within(foot + (mirrored + 1e-3 * reach)[:, None] * normal),
        np.exp(-np.maximum(depth - reach, 0.0) / reach),
        flowing(low + extent * sobol_points(4096, dimension, seed=1)),
        flowing(lines),
        line_points,
        extent[-1] / line_points,
    )


def _measure(source, result, points: _ResamplingPoints) -> ResamplingError:
    """Compare both fields at scattered points, and along lines parallel to the last axis (z)."""
    change, _ = _difference(source, result, points.probe)
    along_lines, slope = _difference(source, result, points.lines)
    shape = LINE_COUNT, points.line_points
    opd = points.length * along_lines.reshape(shape).sum(axis=1)
    deflection = points.length * slope.reshape(shape).sum(axis=1)
    return ResamplingError(
        source=source,
        spacing=tuple(float(s) for s in result.samples.spacing),
        contrast_rms=float(np.sqrt(np.mean(change**2))),
        contrast_max=float(max(np.abs(change).max(), np.abs(along_lines).max())),
        opd_rms=float(np.sqrt(np.mean(opd**2))),
        opd_max=float(np.abs(opd).max()),
        direction_rms=float(np.sqrt(np.mean(deflection**2))),
    )


def _difference(source, result, points: _PointSet) -> tuple[np.ndarray, np.ndarray]:
    """Return the changes of the contrast and of its slope across the lines [1/m], shape (n,) each; zero in the body."""
    value, slope = np.zeros((2, points.count))
    before, slope_before = points.evaluate(source)
    after, slope_after = points.evaluate(result)
    value[points.rows] = after - before
    slope[points.rows] = (slope_after - slope_before)[:, 0]
    return value, slope


def node_counts(field, low: np.ndarray, high: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the number of nodes along each axis of a grid that divides a region of a field evenly.

    `low` and `high` are the corners of the region and `step` the greatest spacing [m], shape (d,).
    """
    extent = high - low
    size = " by ".join(f"{side:.3g}" for side in extent) + " m"
    with np.errstate(over="ignore"):
        cells = np.ceil(extent / step * (1 - 1e-12))  # as float64: a spacing of 1e-300 m would overflow integers
    own = field.spacing if field.is_uniform else np.zeros(len(extent))
    coarse = (cells < LEAST_CELLS) & (step > own * (1 + 1e-9))
    if coarse.any():
        most = extent[coarse].min() / LEAST_CELLS
        raise ValueError(
            f"spacing {_text(step)} m leaves fewer than {LEAST_CELLS} cells along a side of the region of {size}, "
            f"which cannot resolve a flow: give at most {most:.3g} m, better a hundredth of the region, in metres"
        )
    with np.errstate(over="ignore"):
        nodes = float(np.prod(np.maximum(cells, 1.0) + 1.0))
    # Greatest memory that resampling needs per node, measured on the shipped flows.
    limit = min(NODE_LIMIT, host_memory() / 300)
    if nodes > limit:
        least = float((extent.prod() / limit) ** (1.0 / len(extent)))
        raise ValueError(
            f"spacing {_text(step)} m needs {nodes:.3g} nodes in the region of {size}, more than the {limit:.2g} "
            f"that the memory takes: give a greater spacing or a smaller region; this region takes {least:.2g} m"
        )
    return np.maximum(cells, 1.0).astype(int) + 1


def _text(step: np.ndarray) -> str:
    steps = [f"{value:g}" for value in step]
    return steps[0] if len(set(steps)) == 1 else " by ".join(steps)
