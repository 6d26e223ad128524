"""What planning asks of a grid, worked out on a device: NumPy's, but for rounding."""

from contextlib import nullcontext

import numpy as np
import pytest

from aerokernels import IndexField, RayBundle, trace
from aerokernels.medium import spline
from aerokernels.medium.grid import UniformGrid
from aerokernels.tracing import grid_tables
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.engines.interface import GRID_TABLES
from aerokernels.tracing.error_limit import potential_peaks
from aerokernels.tracing.leapfrog.unresolved import potential_by_blocks
from aerokernels.tracing.step_bound import roughness_of_blocks

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
    monkeypatch.setattr(grid_tables, "LEAST_NODES", 0)
    choices = on(engine)
    for shape, has_own_memory in (((5, 9, 11), False), ((13, 6, 8), True), ((7, 5, 17), False)):
        here, there = (volume(shape, 1, ambient_index=1.3).samples for _ in range(2))
        device = engine_of(choices["backend"], choices["device"])
        device.is_gpu |= has_own_memory  # where nothing is shared with the host
        device.grid_tables = GRID_TABLES  # on a processor only here
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
        device.grid_tables = GRID_TABLES
        grid_tables.prepare_grid(device, there)
        assert {each.function for each in MADE} <= set(there.__dict__["_derived"])
        _check_equal(there, here)


@pytest.mark.parametrize("engine", ENGINES)
def test_greatest_values_along_an_axis_of_one_node(engine):
    """The axis that a grid of two axes lacks: one block, with the sizes of all values; an integer is divided by 1."""
    choices = on(engine)
    device = engine_of(choices["backend"], choices["device"])
    values = np.random.default_rng(8).normal(size=77)
    made, found = device.empty(len(values)), np.empty(len(values))
    before = [device.put(values), 1, len(values), 1]
    device.launch(device.kernels(["block_maxima"])["block_maxima"], before, [made], len(values))
    device.get(made, found)
    np.testing.assert_array_equal(found, np.abs(values))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_mirrored_end_is_solved_as_by_numpy(engine):
    """Lines of an axis that is mirrored at its first node, of 4 and of 7 nodes: the kernel alone."""
    choices = on(engine)
    device = engine_of(choices["backend"], choices["device"])
    for count in (4, 7):
        values = np.random.default_rng(count).normal(size=(count, 3))
        made, found = device.empty((count + 2) * 3), np.empty((count + 2) * 3)
        before = [device.put(values.ravel()), device.put(spline.pivots(count, True)), count, 3, 1, 0.0]
        device.launch(device.kernels(["spline_lines"])["spline_lines"], before, [made], 3)
        device.get(made, found)
        assert close(found.reshape(count + 2, 3), spline.spline_along(values, 0, True))


def test_only_other_values_of_a_known_pupil_are_prepared_there(monkeypatch):
    """Grids of few nodes, and on a GPU those of two axes, are left to NumPy."""
    asked = []
    monkeypatch.setattr(grid_tables, "GridTables", lambda engine, grid: asked.append(grid.shape) or 1 / 0)
    engine = engine_of("warp", "cpu")
    engine.grid_tables = GRID_TABLES
    for grid in (volume((5, 5, 9), 1).samples, volume((3, 200, 200), 1).samples):
        grid_tables.prepare_grid(engine, grid)
    for grid in (volume((100, 100, 7), 1).samples, flat((2000, 7), "planar").samples):  # less than a processor's vector
        grid_tables.prepare_grid(engine, grid)
    grid_tables.prepare_grid(engine, flat((60, 60), "planar").samples)
    for is_gpu in (True, False):
        engine.is_gpu = is_gpu
        assert not asked
        with nullcontext() if is_gpu else pytest.raises(ZeroDivisionError):
            grid_tables.prepare_grid(engine, flat((200, 200), "planar").samples)
    with pytest.raises(ZeroDivisionError):
        grid_tables.prepare_grid(engine, volume((4, 100, 100), 1).samples)
    assert asked == [(200, 200), (4, 100, 100)]
    grid_tables.prepare_grid(engine_of("warp", "cpu"), volume((4, 100, 100), 1).samples)


def test_a_processor_prepares_grids_of_many_nodes_at_their_first_trace(monkeypatch):
    """The answer is that of NumPy's tables, except for rounding; fewer nodes are left to NumPy, as is Warp there."""
    monkeypatch.setattr(grid_tables, "LEAST_NODES", 0)
    rays = RayBundle([[3e-4, 8e-4, -1e-4]], [[0.0, 0.05, 1.0]])
    traced = {}
    for backend in ("opencl", "warp"):
        choices = on(f"{backend}-cpu")
        for many in (487, 486):
            monkeypatch.setattr(grid_tables, "MANY_NODES", many)
            field = volume((6, 9, 9), 3)
            traced[backend, many] = trace(field, rays, method="fixed", step=1e-4, **choices).opd
            engine = engine_of(choices["backend"], choices["device"])
            assert (field.samples.held(engine.grid_key) is not None) == (backend == "opencl" and many <= 6 * 9 * 9)
        np.testing.assert_allclose(traced[backend, 487], traced[backend, 486], rtol=1e-6)
