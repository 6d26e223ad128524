"""Sample a field in layers across a wave, through the same interpolant as the rays."""

import math
from itertools import pairwise

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid, contrast_on_axes
from ..tracing.lines import box_span, cell_along
from .wave import Wave

# Most layers of the path through the box, and fewest steps.
MOST_LAYERS, FEWEST_STEPS = 512, 2


def path_range(field: IndexField, wave: Wave) -> tuple[float, float]:
    """Return the distances along the wave's normal between which its window meets the field's box [m]."""
    across, up = (np.linspace(axis[0], axis[-1], 17) for axis in wave.coordinates)
    start = _points(wave, across, up)
    span = box_span(field, start, np.broadcast_to(wave.normal, start.shape).copy())
    meets = span.meets & (span.leave > 0.0) & (span.leave < 1e30)
    if not meets.any():
        raise ValueError("the wave does not meet the field: check its centre, its normal and the units (metres)")
    return max(float(span.enter[meets].min()), 0.0), float(span.leave[meets].max())


def _points(wave: Wave, across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return points of a wave's plane [m], row by row, shape (n, 3)."""
    x, y = (axis.ravel() for axis in np.meshgrid(across, up))
    return np.asarray(wave.center + x[:, None] * wave.axes[0] + y[:, None] * wave.axes[1])


def along_z(field: IndexField, normal: np.ndarray) -> bool:
    """Return whether layers across a normal run along the axes of the field's uniform grid."""
    return field.is_uniform and abs(abs(float(normal[2])) - 1.0) < 1e-15


def layer_count(field: IndexField, length: float, step_count: int | None, most: int = MOST_LAYERS) -> int:
    """Return the number of layers of a path of a length [m]: a power of two, or a multiple of `step_count`."""
    cells = min(math.ceil(length / float(np.min(field.spacing))), most)
    if step_count is None:
        return 2 ** math.ceil(math.log2(max(cells, FEWEST_STEPS)))
    return step_count * max(1, -(-cells // step_count))


def mean_layers(
    field: IndexField,
    wave: Wave,
    begin: float,
    end: float,
    count: int,
    cells_apart: float = 1.0,
    most_parts: int | None = None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return optical paths [m] of `count` layers, float32, (count, rows, columns), and a mask of where they are opaque.

    A layer thicker than `cells_apart` cells is the mean of several samples, of `most_parts` (16 if None) at most, so
    that a thin shock crossed at a slant is not missed. Light that starts inside a body begins where it leaves it, as
    rays do, and other light ends on it; the mask is None without a body.
    """
    cell = cells_apart * float(cell_along(field, wave.normal[None])[0])
    parts = min(max(math.ceil((end - begin) / (count * cell) - 1e-9), 1), most_parts or 16)
    if parts == 1 and field.body is None:
        return sample_layers(field, wave, begin, end, count), None
    thickness = (end - begin) / count
    layers = np.empty((count, *wave.amplitude.shape), dtype=np.float32)
    opaque = None if field.body is None else np.zeros(layers.shape, dtype=bool)
    behind = _in_body(field, wave, 0.0)
    for first in range(0, count, 16):
        last = min(first + 16, count)
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
        points = _points(wave, *wave.coordinates) + distance * wave.normal
        inside = field.body.contains(field.local_coordinates(points)).reshape(inside.shape)
    return inside


def check_memory(count: int, pixels: int) -> None:
    """Check that layers, each of so many pixels, do not need too much memory."""
    memory = 4 * count * pixels
    if memory > 2 << 30:
        raise ValueError(
            f"{count} layers of {pixels} pixels need {memory / 2**30:.1f} GiB: take a smaller pixel_count, or a field "
            "without the undisturbed air around the flow"
        )


def sample_layers(field: IndexField, wave: Wave, begin: float, end: float, count: int) -> np.ndarray:
    """Return the optical paths [m] of layers between two distances along the normal [m], sampled at their middles.

    Float32, shape (count, rows, columns). Of a layer that a face of the box cuts, the part in the box counts.
    """
    edges = np.linspace(begin, end, count + 1)
    if along_z(field, wave.normal):
        low, high = sorted(float(wave.normal[2] * (place - wave.center[2])) for place in np.array(field.box)[:, 2])
        edges = np.clip(edges, low, high)
        parts = np.diff(edges).astype(np.float32)
        return _along_z(field, wave, 0.5 * (edges[:-1] + edges[1:])) * parts[:, None, None]
    plane = _points(wave, *wave.coordinates)
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
        result = contrast_on_axes(field.samples, [y, z]).T
        return np.array(np.broadcast_to(result[:, :, None], shape), dtype=np.float32)
    radius = np.hypot(y[:, None], x)  # equal within a share of 1e-9 counts as equal
    distinct, place = np.unique(np.rint(radius / (1e-9 * radius.max())), return_inverse=True)
    result = contrast_on_axes(field.samples, [distinct * (1e-9 * radius.max()), z]).T
    return result.astype(np.float32)[:, place.ravel()].reshape(shape)
