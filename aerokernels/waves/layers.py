"""Sample a field in layers across a wave, through the same interpolant as the rays."""

import math
from itertools import pairwise

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..medium.tensor_points import contrast_on_axes
from ..tracing.lines import box_span, cell_along
from .wave import Wave

# Most layers of the path through the box, and fewest steps.
MOST_LAYERS, FEWEST_STEPS = 512, 2
# Most samples along the path through a layer, and layers sampled together.
MOST_PARTS, CHUNK_LAYERS = 16, 16
# Lines along a side of a window from which its path through the box is found.
LINES = 17
# Most bytes of the sampled layers.
GREATEST_MEMORY = 2 << 30
# Distances from the axis that differ by less than this share of the greatest one count as equal.
SAME_RADIUS = 1e-9


def path_range(field: IndexField, wave: Wave) -> tuple[float, float]:
    """Return the distances along the wave's normal between which its window meets the field's box [m].

    Raises:
        ValueError: The window does not meet the box.
    """
    across, up = ((axis[0], axis[-1]) for axis in wave.coordinates)
    return span_of(field, wave.center, wave.normal, wave.axes, across, up)


def span_of(
    field: IndexField,
    center: np.ndarray,
    normal: np.ndarray,
    axes: tuple[np.ndarray, np.ndarray],
    across: tuple[float, float],
    up: tuple[float, float],
) -> tuple[float, float]:
    """Return the distances as `path_range` does, for lines between two positions along both axes [m].

    Raises:
        ValueError: No line meets the field.
    """
    if abs(abs(float(normal[2])) - 1.0) <= 1e-15:
        middle = center + 0.5 * (across[0] + across[1]) * axes[0] + 0.5 * (up[0] + up[1]) * axes[1]
        (x, y, _), (low, high) = middle.tolist(), (corner.tolist() for corner in field.box)
        inside = (
            math.hypot(x, y) < high[0]
            if field.geometry == "axisymmetric"
            else low[0] < x < high[0] and low[1] < y < high[1]
        )
        ends = sorted(float(normal[2]) * (end - float(center[2])) for end in (low[2], high[2]))
        if inside and ends[1] > 0.0:
            return max(ends[0], 0.0), ends[1]
    right, above = (axis.ravel() for axis in np.meshgrid(np.linspace(*across, LINES), np.linspace(*up, LINES)))
    start = center + right[:, None] * axes[0] + above[:, None] * axes[1]
    span = box_span(field, start, np.broadcast_to(normal, start.shape).copy())
    meets = span.meets & (span.leave > 0.0) & (span.leave < 1e30)
    if not meets.any():
        raise ValueError("the wave does not meet the field: check its centre, its normal and the units (metres)")
    return max(float(span.enter[meets].min()), 0.0), float(span.leave[meets].max())


def layer_count(field: IndexField, length: float, step_count: int | None, most: int = MOST_LAYERS) -> int:
    """Return the number of layers of a path of a length [m]: a power of two, or a multiple of `step_count`.

    At least one per cell, but `most` limits the number of cells that count.
    """
    cells = min(math.ceil(length / float(np.min(field.spacing))), most)
    if step_count is None:
        return 2 ** math.ceil(math.log2(max(cells, FEWEST_STEPS)))
    return step_count * max(1, -(-cells // step_count))


def mean_layers(
    field: IndexField, wave: Wave, begin: float, end: float, count: int, cells_apart: float = 1.0
) -> tuple[np.ndarray, np.ndarray | None]:
    """Sample layers as `sample_layers` does, with several samples in a layer that is thicker than `cells_apart` cells.

    So a thin shock crossed at a slant is not missed between two samples. There is no air inside a body: light that
    starts inside it begins where it leaves the body, as rays do, and other light ends on it.

    Returns:
        Optical paths [m], float32, shape (count, rows, columns), and a mask of where layers are opaque, of that shape;
        None without a body.
    """
    cell = cells_apart * float(cell_along(field, wave.normal[None])[0])
    parts = min(max(math.ceil((end - begin) / (count * cell) - 1e-9), 1), MOST_PARTS)
    if parts == 1 and field.body is None:
        return sample_layers(field, wave, begin, end, count), None
    thickness = (end - begin) / count
    layers = np.empty((count, *wave.amplitude.shape), dtype=np.float32)
    opaque = None if field.body is None else np.zeros(layers.shape, dtype=bool)
    behind = _in_body(field, wave, 0.0)
    for first in range(0, count, CHUNK_LAYERS):
        last = min(first + CHUNK_LAYERS, count)
        ends = begin + first * thickness, begin + last * thickness
        sampled = sample_layers(field, wave, *ends, (last - first) * parts)
        if opaque is not None:
            for number, path in enumerate(sampled):
                inside = _in_body(field, wave, ends[0] + (number + 0.5) * thickness / parts)
                behind &= inside
                path[inside] = 0.0
                opaque[first + number // parts] |= inside & ~behind
        layers[first:last] = sampled.reshape(last - first, parts, *layers.shape[1:]).sum(axis=1)
    return layers, opaque


def _in_body(field: IndexField, wave: Wave, distance: float) -> np.ndarray:
    """Return a mask of the pixels inside the field's body at a distance along the normal [m], shape (rows, columns)."""
    inside = np.zeros(wave.amplitude.shape, dtype=bool)
    if field.body is not None:
        x, y = (axis.ravel() for axis in np.meshgrid(*wave.coordinates))
        points = wave.center + distance * wave.normal + x[:, None] * wave.axes[0] + y[:, None] * wave.axes[1]
        inside = field.body.contains(field.local_coordinates(points)).reshape(inside.shape)
    return inside


def check_memory(count: int, pixels: int) -> None:
    """Check that layers, each of so many pixels, do not need too much memory.

    Raises:
        ValueError: They do.
    """
    memory = 4 * count * pixels
    if memory > GREATEST_MEMORY:
        raise ValueError(
            f"{count} layers of {pixels} pixels need {memory / 2**30:.1f} GiB: take a smaller pixel_count, or a field "
            "without the undisturbed air around the flow"
        )


def sample_layers(field: IndexField, wave: Wave, begin: float, end: float, count: int) -> np.ndarray:
    """Return the optical paths [m] of layers between two distances along the normal [m], sampled at their middles.

    Of a layer that a face of the box cuts, the part in the box counts: the contrast ends there.

    Returns:
        Paths, float32, shape (count, rows, columns).
    """
    edges = np.linspace(begin, end, count + 1)
    if field.is_uniform and abs(abs(float(wave.normal[2])) - 1.0) < 1e-15:
        low, high = sorted(float(wave.normal[2] * (place - wave.center[2])) for place in np.array(field.box)[:, 2])
        edges = np.clip(edges, low, high)
        parts = np.diff(edges).astype(np.float32)
        return _along_z(field, wave, 0.5 * (edges[:-1] + edges[1:])) * parts[:, None, None]
    x, y = (axis.ravel() for axis in np.meshgrid(*wave.coordinates))
    first, second = wave.axes
    plane = wave.center + x[:, None] * first + y[:, None] * second
    box = box_span(field, plane, np.broadcast_to(wave.normal, plane.shape).copy())
    enter, leave = (np.where(box.meets, ends, 0.0) for ends in (box.enter, box.leave))
    layers = np.empty((count, *wave.amplitude.shape), dtype=np.float32)
    for number, (near, far) in enumerate(pairwise(edges)):
        first = np.maximum(near, enter)
        part = np.minimum(far, leave) - first
        crossed = part > 0.0
        inside = np.where(crossed, first + 0.5 * part, near)
        contrast = field.contrast_at(plane + inside[:, None] * wave.normal)
        layers[number] = np.where(crossed, part * contrast, 0.0).reshape(wave.amplitude.shape)
    return layers


def _along_z(field: IndexField, wave: Wave, depth: np.ndarray) -> np.ndarray:
    """Return the contrast of the layers of a wave along z, whose pixels run along the field's axes; float32."""
    across, up = wave.coordinates
    x = wave.center[0] + across * wave.axes[0][0]
    y = wave.center[1] + up * wave.axes[1][1]
    z = wave.center[2] + depth * wave.normal[2]
    shape = (len(z), len(y), len(x))
    assert isinstance(field.samples, UniformGrid)
    if field.geometry == "volume":
        return np.transpose(contrast_on_axes(field.samples, [x, y, z]), (2, 1, 0)).astype(np.float32)
    if field.geometry == "planar":
        found = contrast_on_axes(field.samples, [y, z]).T
        return np.array(np.broadcast_to(found[:, :, None], shape), dtype=np.float32)
    radius = np.hypot(y[:, None], x)
    distinct, place = np.unique(np.rint(radius / (SAME_RADIUS * radius.max())), return_inverse=True)
    found = contrast_on_axes(field.samples, [distinct * (SAME_RADIUS * radius.max()), z]).T
    return found.astype(np.float32)[:, place.ravel()].reshape(shape)
