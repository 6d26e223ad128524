"""The kernel arguments that describe a family, its stop and the field's box: an array of floats, and a few integers."""

import numpy as np

from aerokernels.tracing.engines.layout import OPTIONS
from aerokernels.tracing.plan import output_mask
from aerokernels.tracing.stop import ArcLength, Plane
from aerokernels.tracing.tasks.family import FAR, LEAST_COSINE, BundleTable, Family


def _numbered(option: str) -> dict[str, int]:
    """The choices of an option as the header options.h numbers them."""
    choices = OPTIONS[option].choices
    assert isinstance(choices, tuple)
    return {name: number for number, name in enumerate(choices, start=1)}


STOPS, SHAPES = _numbered("stop"), _numbered("geometry")
# Length of `frame`, and of its part that describes the family.
FRAME_SIZE, FAMILY_SIZE = 41, 26


def frame_of(table: BundleTable) -> np.ndarray:
    """The kernels' array `frame`, shape (41,)."""
    until, field = table.classes.until, table.classes.field
    is_plane = isinstance(until, Plane)
    low, high = field.box
    numbers = [
        until.point if is_plane else np.zeros(3),
        until.normal if is_plane else np.array([0.0, 0.0, 1.0]),
        [until.length if isinstance(until, ArcLength) else 0.0],
        low,
        high,
        [field.ambient_index, table.classes.margin],
    ]
    return _flat(family_numbers(table.family, table.rate), *numbers)


def family_numbers(family: Family, rate: np.ndarray | None = None) -> np.ndarray:
    """The first numbers of `frame`, which describe a family; `rate` is that of a table of the family."""
    has_plane = family.start_point is not None
    frame = _flat(
        family.low,
        np.zeros(2) if rate is None else rate,
        family.origin,
        family.axes,
        family.start_point if has_plane else np.zeros(3),
        family.start_normal,
        [has_plane, family.ahead, family.close, LEAST_COSINE],
    )
    assert len(frame) == FAMILY_SIZE
    return frame


def _flat(*parts) -> np.ndarray:
    return np.clip(np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in parts]), -FAR, FAR)


def kernel_arrays(table: BundleTable) -> list[np.ndarray]:
    """The kernels' arrays, flat: block_map, header, patches, frame."""
    frame = frame_of(table)
    assert len(frame) == FRAME_SIZE
    return [table.map.ravel(), table.header.ravel(), table.values.ravel(), frame]


def kernel_numbers(table: BundleTable, outputs: frozenset) -> list[int]:
    """The scalar arguments of the kernel up to the rays: from map_u to outputs."""
    until = table.classes.until
    stop = STOPS["plane" if isinstance(until, Plane) else "none" if until is None else "arc"]
    faces = sum(1 << face for face, matters in enumerate(table.classes.matters) if matters)
    shape = SHAPES[table.classes.field.geometry]
    checks = not table.classes.are_all_alike
    return [*table.map.shape, int(table.family.converges), stop, shape, int(checks), faces, output_mask(outputs)]
