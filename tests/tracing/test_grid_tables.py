"""What planning asks of a grid, worked out on a device: NumPy's, but for rounding."""

import numpy as np
import pytest

from aerokernels import IndexField, RayBundle, trace
from aerokernels.medium.grid import UniformGrid
from aerokernels.tracing import grid_tables
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.engines.interface import GRID_TABLES
from aerokernels.tracing.error_limit import potential_peaks
from aerokernels.tracing.step_bound import roughness_of_blocks
from aerokernels.tracing.tasks.unresolved import potential_by_blocks

from .backends import ENGINES, on

SPACING = (1e-4, 2e-4, 1.5e-4)
MADE = roughness_of_blocks, potential_by_blocks, potential_peaks


def volume(shape: tuple[int, ...], seed: int, **more) -> IndexField:
    """Values without any order, so that no two entries of a table are the same."""
    values = np.random.default_rng(seed).normal(0.0, 1e-3, shape)
    return IndexField.from_samples(values, origin=(0.0,) * 3, spacing=SPACING, geometry="volume", **more)


def flat(shape: tuple[int, int], geometry: str) -> IndexField:
    """The same along two axes."""
    values = np.random.default_rng(2).normal(0.0, 1e-3, shape)
    return IndexField.from_samples(values, origin=(0.0, 0.0), spacing=SPACING[:2], geometry=geometry, ambient_index=1.3)


def close(one: np.ndarray, other: np.ndarray) -> bool:
    """Equal within some roundings of the greatest entry."""
    return one.shape == other.shape and bool(np.abs(one - other).max() <= 2e-14 * np.abs(other).max())


def _check_equal(there: UniformGrid, here: UniformGrid) -> None:
    """Compare a grid's tables made on a device with NumPy's."""
    assert close(there.coefficients, here.coefficients)
    block, fourth, kinks = roughness_of_blocks(there)
    expected = roughness_of_blocks(here)
    assert block == expected[0] and not np.any(kinks)
    for found, known in zip(fourth, expected[1], strict=True):
        assert close(found, known)
    assert close(potential_by_blocks(there), potential_by_blocks(here))
    for found, known in zip(potential_peaks(there), potential_peaks(here), strict=True):
        assert close(found, known)


@pytest.mark.parametrize("engine", ENGINES)
def test_tables_of_a_device_are_numpys(engine, monkeypatch):
    """Axes of five nodes (a spline of four has no fourth difference), of whole blocks and others; strong contrast."""
    choices = on(engine)
    for shape, has_own_memory in (((5, 9, 11), False), ((13, 6, 8), True), ((7, 5, 17), False)):
        here, there = (volume(shape, 1, ambient_index=1.3).samples for _ in range(2))
        monkeypatch.undo()
        monkeypatch.setattr(grid_tables, "LEAST_NODES", 0)
        device = engine_of(choices["backend"], choices["device"])
        own = device.is_gpu or has_own_memory  # where nothing is shared with the host
        monkeypatch.setattr(device, "is_gpu", own)
        monkeypatch.setattr(device, "grid_tables", GRID_TABLES)  # on a processor only here
        grid_tables.prepare_grid(device, there)
        assert {each.function for each in MADE} <= set(there.__dict__["_derived"])
        assert there.coefficient_shape == here.coefficients.shape
        _check_equal(there, here)


@pytest.mark.parametrize("engine", ENGINES)
def test_tables_of_two_axes_are_numpys(engine, monkeypatch):
    """Mirrored at the axis or not; the samples of both are the same."""
    monkeypatch.setattr(grid_tables, "LEAST_FLAT", 0)
    choices = on(engine)
    for geometry, shape in (("axisymmetric", (9, 14)), ("planar", (9, 14)), ("axisymmetric", (5, 8))):
        here, there = (flat(shape, geometry).samples for _ in range(2))
        device = engine_of(choices["backend"], choices["device"])
        if device.is_gpu:
            pytest.skip("left to NumPy there")
        monkeypatch.setattr(device, "grid_tables", GRID_TABLES)
        grid_tables.prepare_grid(device, there)
        assert {each.function for each in MADE} <= set(there.__dict__["_derived"])
        _check_equal(there, here)


@pytest.mark.parametrize("backend", ["opencl", "warp"])
def test_a_processor_prepares_grids_of_many_nodes_at_their_first_trace(backend, monkeypatch):
    """The answer is that of NumPy's tables, except for rounding; fewer nodes are left to NumPy, as is Warp there."""
    monkeypatch.setattr(grid_tables, "LEAST_NODES", 0)
    rays = RayBundle([[3e-4, 8e-4, -1e-4]], [[0.0, 0.05, 1.0]])
    traced, choices = [], on(f"{backend}-cpu")
    for many in (487, 486):
        monkeypatch.setattr(grid_tables, "MANY_NODES", many)
        field = volume((6, 9, 9), 3)
        traced.append(trace(field, rays, method="adaptive", **choices).opd)
        engine = engine_of(choices["backend"], choices["device"])
        assert (field.samples.held(engine.grid_key) is not None) == (backend == "opencl" and many <= 6 * 9 * 9)
    np.testing.assert_allclose(*traced, rtol=1e-6)
