"""Structure between samples, bounded on a device: the same as on the host, but for rounding."""

from itertools import product

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, RayBundle
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.grid_tables import GridTables
from aerokernels.tracing.leapfrog.between_samples import MissedStructure
from aerokernels.tracing.leapfrog.structure_on_device import StructureOnDevice

from ..backends import ENGINES, on

SHAPES = {"volume": (21, 26, 43), "planar": (26, 43), "axisymmetric": (21, 43)}
SPACING = {"volume": (1.1e-4, 1e-4, 1.5e-4), "planar": (1e-4, 1.5e-4), "axisymmetric": (1.1e-4, 1.5e-4)}
AMBIENT = 1.2


def rough(geometry: str, seed: int, scale: float = 1.0) -> IndexField:
    """Values without any order; the same nodes each time."""
    shape, spacing = SHAPES[geometry], SPACING[geometry]
    values = scale * 1e-4 * np.random.default_rng(seed).normal(size=shape)
    values[..., :9] *= 1e-3  # rays end in stronger air than they begin in
    origin = [-0.5 * step * (count - 1) for step, count in zip(spacing, shape, strict=True)]
    if geometry == "axisymmetric":
        origin[0] = 0.0
    return IndexField.from_samples(values, origin=origin, spacing=spacing, geometry=geometry, ambient_index=AMBIENT)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", list(SHAPES))
def test_the_bound_is_that_of_the_host(engine: str, geometry: str):
    """Rays along an axis, slanted, along no axis, toward stops at right angles and others; limits of any size."""
    choices = on(engine)
    device = engine_of(choices["backend"], choices["device"])
    known = rough(geometry, 1)
    greatest: set[float] = set()
    exact = 0
    for way, tilt in product(((0.0, 0.0, 1.0), (0.05, 0.2, 1.0), (0.3, -0.8, 0.7)), (0.0, 0.6)):
        pupil = Disc(6e-4, center=(1e-4, 2e-4, -1e-4), normal=way)
        rays = RayBundle.collimated(pupil, 40, seed=3)
        until = Plane(np.array((0.0, 0.0, 8e-3)), (tilt, 0.0, 1.0))
        structure = MissedStructure(known, rays, until, 1e-9, None, rays)
        tables = GridTables(device, known.samples)
        there = StructureOnDevice(device, structure, 42, tables.block, tuple(tables.blocks))
        reading = device.fetched(there.arrays)
        for seed, limit in ((2, 1e-9), (3, 1e-6), (4, 1e-2)):
            field = rough(geometry, seed, 10.0 ** (4 - seed))
            tables.start(device.share(field.samples.samples.reshape(-1)))
            there.start(tables.in_blocks, reading.buffers)
            reading.start()
            expected, found = structure.of_values(field, limit)._by_rule(42), there.greatest(reading.wait(), limit)
            # Layers across another axis than the one that the lines run along most hardly ever bound it better.
            assert found == pytest.approx(expected, rel=1e-11) or expected < found < 1.2 * expected
            assert there.is_enough(reading.arrays, limit) == (found <= 0.75 * limit)
            greatest.add(found)
            exact += found == pytest.approx(expected, rel=1e-11)
    assert len(greatest) == 18 and exact >= 15
