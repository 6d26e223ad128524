"""What a device does again and again: pilots by one preparation, pupils without waiting between, rows of cubes."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, RayBundle, prepare_strehl
from aerokernels.tracing import grid_tables
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.launch import Trials, launch
from aerokernels.tracing.planning import plan_rays

from ..backends import ENGINES, WAVE, on

H = 1e-4
pytestmark = pytest.mark.filterwarnings("ignore:.*looks through disturbed air")
OUTPUTS = frozenset(("opd", "step_error", "direction"))
STOP = Plane((0.0, 0.0, 17.0 * H), (0.0, 0.0, 1.0))


def blob() -> IndexField:
    """One of contrast 6e-4, 5 cells wide, without symmetry, in 18 x 17 x 16 cells."""
    x, y, z = np.meshgrid(*(np.arange(count) - 0.5 * (count - 1) for count in (19, 18, 17)), indexing="ij")
    made = 6e-4 * np.exp(-((x - 0.4) ** 2 + y**2 + (0.5 * z) ** 2) / 25.0)
    return IndexField.from_samples(made, origin=(0.0, 0.0, 0.0), spacing=(H,) * 3, geometry="volume", wavelength=WAVE)


def rays(count: int) -> RayBundle:
    """Incoherent ones, from the face z = 0, that stay in the box."""
    rng = np.random.default_rng(3)
    start = np.c_[rng.uniform(5.0 * H, 12.0 * H, (count, 2)), np.zeros(count)]
    return RayBundle(start, np.c_[rng.normal(0.0, 0.02, (count, 2)), np.ones(count)])


def leapfrog_plan(name: str, field: IndexField, bundle: RayBundle):
    """Plan of leapfrog samples on a device."""
    choices = {"precision": "float32", "tolerance": 1e-3, **on(name)}
    plan = plan_rays(
        field, lambda: bundle.rows(slice(0, 64)), 1 << 20, STOP, wavelength=WAVE, path_length=None, max_steps=None,
        method="auto", step=None, directions=bundle.direction, **choices,
    )  # fmt: skip
    assert plan.sample_count
    return plan


@pytest.mark.parametrize("name", ENGINES)
def test_trials_are_what_a_launch_of_their_numbers_is(name: str):
    field, bundle = blob(), rays(48)
    plan = replace(leapfrog_plan(name, field, bundle), cubes=False, sampling=None)
    trials = Trials(field, bundle, plan, STOP, WAVE, OUTPUTS)
    asked = (36, 1.0, 0.0), (108, 1.0, 0.0), (36, 0.0, 1.0), (36, 1.0, 0.0)
    together = trials(*asked)
    for one, at_once in zip(asked, together, strict=True):
        count, quadrature, trajectory = one
        numbers = {"quadrature_error_scale": quadrature, "trajectory_error_scale": trajectory}
        alone = launch(field, bundle, replace(plan, sample_count=count, **numbers), STOP, WAVE, OUTPUTS)
        for made in (at_once, *trials(one)):
            for output, found in made.items():
                assert np.array_equal(found, np.asarray(alone[output])), (output, count)


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("remove", [("piston",), ("piston", "tilt")])
def test_a_prepared_pupil_answers_each_seed_as_a_new_one_does(name: str, remove: tuple[str, ...]):
    """From the second call on a GPU may do all of it as one: seeds, places and sums are those of the call."""
    options = {"wavelength": WAVE, "remove": remove, "ray_count": 1 << 14, "allow_truncation": True, **on(name)}
    pupil = Disc(4e-4, (8.5 * H, 8.2 * H, -1e-3), (0.05, 0.02, 1.0))
    field = blob()
    prepared = prepare_strehl(field, pupil, **options)
    for seed in (3, 4, 5, 3):
        again, alone = prepared(seed), prepare_strehl(field, pupil, **options)(seed)
        assert (again.value, again.standard_error) == (alone.value, alone.standard_error)
        assert np.array_equal(again.boresight, alone.boresight)


@pytest.mark.parametrize("name", ENGINES)
def test_buffers_are_sent_and_fetched_together(name: str):
    """Of three types and lengths, twice; what is sent is there, what is fetched is what the buffers hold then."""
    engine = engine_of(**on(name))
    arrays = [np.arange(5, dtype=np.int32), np.linspace(0.0, 1.0, 7), np.arange(3, dtype=np.uint32)]
    arrays.append(np.arange(12.0).reshape(4, 3))
    read = engine.fetched([np.zeros_like(array) for array in arrays])
    sent = engine.sent(np.zeros(4, np.uint32))
    for number in (1, 2):
        arrays = [array + array.dtype.type(number) for array in arrays]
        for buffer, array in zip(read.buffers, arrays, strict=True):
            engine.put_into(buffer, array)
        sent.array[:] = number
        sent.send()
        read.start()
        assert all(map(np.array_equal, read.wait(), arrays))
        there = np.zeros(4, np.uint32)
        engine.get(sent.buffer, there)
        assert np.all(there == number)
    engine.clear(read.buffers[0])
    read.start()
    assert read.taken()[0][0] == 0


@pytest.mark.parametrize("name", ENGINES)
def test_the_memory_of_a_known_grid_is_free_as_soon_as_its_field_is(name: str, monkeypatch):
    """Without the collector of cycles, which would leave coefficients of many fields on a device."""
    monkeypatch.setattr(grid_tables, "LEAST_NODES", 0)
    pupil = Disc(4e-4, (8.5 * H, 8.2 * H, -1e-3), (0.05, 0.02, 1.0))
    prepared = prepare_strehl(blob(), pupil, wavelength=WAVE, ray_count=1 << 14, allow_truncation=True, **on(name))
    prepared(0)
    gc.collect()
    gc.disable()
    try:
        field = blob()
        prepared.with_field(field)(0)
        grid = weakref.ref(field.samples)
        del field
        assert grid() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("name", ENGINES)
def test_rays_look_up_the_same_cubes_in_any_company(name: str):
    """Threads of a whole warp look up cubes together, those of a part of one by themselves: the same bits."""
    field, bundle = blob(), rays(4096 + 37)
    plan = replace(leapfrog_plan(name, field, bundle), cubes=True, sampling=None)
    together = launch(field, bundle, plan, STOP, WAVE, OUTPUTS)
    for count in (1, 31, 33, 64 + 5):
        few = launch(field, bundle.rows(slice(0, count)), plan, STOP, WAVE, OUTPUTS)
        for output in OUTPUTS:
            assert np.array_equal(np.asarray(few[output]), np.asarray(together[output])[:count]), (output, count)
