"""The greatest value outside a part of a grid: the host's answers for a known support."""

import numpy as np
import pytest

from aerokernels import IndexField
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.error_limit import left_out, support_box
from aerokernels.tracing.greatest_outside import GreatestOutside, part_of_support
from aerokernels.tracing.grid_tables import GridTables

from .backends import ENGINES, on

SHAPES = {"volume": (19, 24, 31), "planar": (24, 31), "axisymmetric": (24, 31)}
LIMIT = 1e-9


def blob(geometry: str, rng: np.random.Generator) -> IndexField:
    """Air about a place, which fades within some cells, or none."""
    shape = SHAPES[geometry]
    axes = np.meshgrid(*(np.arange(count) for count in shape), indexing="ij")
    place, width = rng.uniform(0.0, 1.0, len(shape)) * shape, rng.uniform(0.4, 1.2)
    square = sum((axis - at) ** 2 for axis, at in zip(axes, place, strict=True))
    contrast = rng.choice([0.0, 1e-7, 1e-5]) * np.exp(-square / width**2)
    origin = [0.0 if geometry == "axisymmetric" else -1e-3, *[2e-3] * (len(shape) - 1)]
    return IndexField.from_samples(contrast, origin=origin, spacing=[1.3e-4] * len(shape), geometry=geometry)


def greatest(device, there: GreatestOutside, values) -> float:
    """Launch for the values in a buffer, and read the result."""
    reading = device.fetched(there.arrays)
    there.start(values, reading.buffers)
    reading.start()
    return there.greatest(reading.wait())


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", list(SHAPES))
def test_a_known_support_holds_where_the_host_finds_so(engine: str, geometry: str):
    """Random blobs in supports of any size, at the faces of the box too, and in the whole box."""
    choices, rng = on(engine), np.random.default_rng(11)
    device = engine_of(choices["backend"], choices["device"])
    known = blob(geometry, rng)
    tables = GridTables(device, known.samples)
    low, high = np.asarray(known.samples.low), np.asarray(known.samples.high)
    answers: list[bool] = []
    for number in range(12):
        cut = rng.uniform(0.01, 0.4, (2, len(low))) * (rng.random((2, len(low))) < 0.4) * (number > 0)
        box = low + cut[0] * (high - low), high - cut[1] * (high - low)
        there = GreatestOutside(device, known.samples.coefficient_shape, part_of_support(known.samples, box))
        assert there.is_whole == (not cut.any())
        for _ in range(6):
            field = blob(geometry, rng)
            tables.start(device.share(field.samples.samples.reshape(-1)))
            found = greatest(device, there, tables.coefficients) <= left_out(field, LIMIT, None)[0]
            begin, end = support_box(field, LIMIT, None)
            is_empty = (begin == end).all()
            assert found == bool(is_empty or ((begin >= box[0]) & (end <= box[1])).all())
            if cut.any():
                answers.append(found and not is_empty)
    assert 5 <= sum(answers) <= len(answers) - 15
