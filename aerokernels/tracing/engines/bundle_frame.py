"""The kernel arguments that describe a family, its stop and the field's box: an array of floats, and a few integers."""

from typing import Any

import numpy as np

from aerokernels.tracing.engines.layout import OPTIONS
from aerokernels.tracing.plan import output_mask
from aerokernels.tracing.stop import ArcLength, Plane
from aerokernels.tracing.tasks.family import FAR, LEAST_COSINE, BundleTable


def _numbered(option: str) -> dict[str, int]:
    """The choices of an option as the header options.h numbers them."""
    choices = OPTIONS[option].choices
    assert isinstance(choices, tuple)
    return {name: number for number, name in enumerate(choices, start=1)}


STOPS, SHAPES = _numbered("stop"), _numbered("geometry")


def kernel_arrays(table: BundleTable) -> list[np.ndarray]:
    """The kernels' arrays, flat: block_map, header, patches, frame; deliver_bundle.py reads `frame` by place."""
    family, until, field = table.family, table.classes.until, table.classes.field
    start = np.zeros(3) if family.start_point is None else family.start_point
    frame: list[Any] = [family.low, table.rate, family.origin, family.axes, start, family.start_normal]  # 22 numbers
    frame += [[family.start_point is not None, family.ahead, family.close, LEAST_COSINE]]
    frame += [until.point, until.normal] if isinstance(until, Plane) else [np.zeros(3), np.array([0.0, 0.0, 1.0])]
    frame += [[until.length if isinstance(until, ArcLength) else 0.0], *field.box]
    frame += [[field.ambient_index, table.classes.margin]]
    numbers = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in frame])
    assert len(numbers) == 41
    return [table.map.ravel(), table.header.ravel(), table.values.ravel(), np.clip(numbers, -FAR, FAR)]


def kernel_numbers(table: BundleTable, outputs: frozenset) -> list[int]:
    """The scalar arguments of the kernel up to the rays: from map_u to outputs."""
    until = table.classes.until
    stop = STOPS["plane" if isinstance(until, Plane) else "none" if until is None else "arc"]
    faces = sum(1 << face for face, matters in enumerate(table.classes.matters) if matters)
    shape = SHAPES[table.classes.field.geometry]
    checks = not table.classes.are_all_alike
    return [*table.map.shape, int(table.family.converges), stop, shape, int(checks), faces, output_mask(outputs)]
