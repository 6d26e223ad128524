"""New values on known nodes: they follow the known plan where it holds, and only there, whatever came before."""

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, RayBundle, prepare_strehl, trace
from aerokernels.tracing.error_limit import support_box
from aerokernels.tracing.pupil import new_values
from aerokernels.tracing.pupil.run import PupilRun
from aerokernels.tracing.step_bound import roughness_of_blocks
from aerokernels.tracing.tasks.unresolved import potential_by_blocks

from ..backends import OPENCL, on

# Engines that compute a grid's tables on their device.
FOLLOWED = [*OPENCL, pytest.param("warp-gpu", marks=pytest.mark.gpu)]
WAVE = 905e-9
COUNT = 33
AXIS = np.linspace(-1.0, 1.0, COUNT)
DISC = Disc(0.4, center=(0.05, -0.1, -1.5), normal=(0.05, 0.02, 1.0))


def air(peak: float = 1e-6, tilt: float = 0.3, add=0.0, fall: float = 14.0) -> IndexField:
    """A blob in a volume of 33^3 nodes that fades to nothing at the faces."""
    x, y, z = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")
    contrast = peak * np.exp(-fall * (x**2 + 1.3 * y**2 + z**2)) * (1.0 + tilt * x) + add
    spacing = (AXIS[1] - AXIS[0],) * 3
    return IndexField.from_samples(contrast, origin=(-1.0,) * 3, spacing=spacing, geometry="volume")


def shell(peak: float = 4e-6, tilt: float = 0.2) -> IndexField:
    """An axisymmetric layer that begins and ends at the faces along z."""
    r, z = np.meshgrid(np.linspace(0.0, 1.0, 81), np.linspace(-1.0, 1.0, 161), indexing="ij")
    contrast = peak * (1.0 + tilt * np.cos(2.0 * z) * r**2) * np.exp(-6.0 * r**2)
    return IndexField.from_samples(contrast, origin=(0.0, -1.0), spacing=(1 / 80, 1 / 80), geometry="axisymmetric")


def prepared(engine: str, field: IndexField, pupil: Disc = DISC, **options):
    return prepare_strehl(
        field, pupil, wavelength=WAVE, ray_count=1 << 17, allow_truncation=True, **options, **on(engine)
    )


def follows(seen) -> bool:
    return isinstance(seen.job.prepared, new_values.FollowedRun)


@pytest.mark.parametrize("engine", FOLLOWED)
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.filterwarnings("ignore:.*looks through disturbed air")
def test_a_field_that_follows_has_the_ratio_that_it_has_by_its_own_plan(engine: str, precision: str):
    """Volumes and axisymmetric fields, by lattices and along a radius; also by the OPD of single rays."""
    axial = Disc(0.4, center=(0.0, 0.0, -1.5))
    for make, pupil in ((air, DISC), (shell, axial)):
        known = prepared(engine, make(), pupil, precision=precision)
        for change in ({"peak": 0.9 * known.field.samples.extremes[1]}, {"tilt": 0.1}):
            seen, alone = known.with_field(make(**change)), prepared(engine, make(**change), pupil, precision=precision)
            assert follows(seen) and not follows(alone)
            found, expected = seen(3), alone(3)
            error = 4.0 * float(np.hypot(found.standard_error, expected.standard_error)) + 3e-6
            assert abs(found.value - expected.value) <= error and found.value < 0.95
            assert found.opd_rms == pytest.approx(expected.opd_rms, rel=1e-4)
            assert found.error["total"] == pytest.approx(expected.error["total"], rel=0.5)
            assert (
                found.plan.reasons[1:] == seen.job.plan.reasons[1:] + found.plan.reasons[len(seen.job.plan.reasons) :]
            )


@pytest.mark.parametrize("engine", FOLLOWED)
def test_answers_do_not_depend_on_the_order_of_the_fields(engine: str):
    """The same bits alone, after other fields, again when another field has the memory, by threads, and in a chain."""
    changes = [{"tilt": 0.1}, {"peak": 0.8e-6}, {"tilt": 0.25, "peak": 1.1e-6}]
    alone = [prepared(engine, air(fall=25.0)).with_field(air(fall=25.0, **change))(5).value for change in changes]
    known = prepared(engine, air(fall=25.0))
    all_seen = [known.with_field(air(fall=25.0, **change)) for change in changes]
    assert all(map(follows, all_seen))
    for seen, value in zip(all_seen, alone, strict=True):
        assert seen(5).value == value and seen(6).value != value and seen(5).value == value
    assert isinstance(all_seen[0].job.prepared.own, PupilRun) and all_seen[2].job.prepared.own is None
    with ThreadPoolExecutor(4) as threads:
        found = list(
            threads.map(lambda number: known.with_field(air(fall=25.0, **changes[number % 3]))(5).value, range(12))
        )
    assert found == [alone[number % 3] for number in range(12)]
    chained = known
    for change, value in zip(changes, alone, strict=True):
        chained = chained.with_field(air(fall=25.0, **change))
        assert chained(5).value == value


@pytest.mark.parametrize("engine", FOLLOWED)
def test_fields_for_which_the_plan_does_not_hold_are_planned(engine: str):
    """Each condition alone: strength, nodes, air outside the support, structure, a weak field."""
    known = prepared(engine, air())
    assert follows(known.with_field(air(tilt=0.1)))
    assert follows(prepared(engine, air(fall=25.0)).with_field(air(tilt=0.1, fall=25.0)))
    x, y, z = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")
    narrow = prepared(engine, air(fall=25.0))
    beside = 3e-9 * np.exp(-20.0 * ((x - 0.1) ** 2 + (y + 0.1) ** 2 + (z - 0.85) ** 2))
    rng = np.random.default_rng(74)
    rough = 5e-9 * rng.normal(size=x.shape) * (np.abs(x) < 0.4) * (np.abs(y) < 0.4) * (np.abs(z) < 0.4)
    moved = replace(air().samples, origin=np.full(3, -0.98), spacing=0.98 * air().spacing)
    others = {
        "strength": air(1.6e-6),
        "nodes": replace(air(), samples=moved),
        "support": air(0.9e-6, add=beside, fall=25.0),
        "structure": air(0.9e-6, add=rough),
        "weak": air(1e-12),
    }
    for name, field in others.items():
        seen = (narrow if name == "support" else known).with_field(field)
        assert not follows(seen), name
        same = replace(field, samples=replace(field.samples))
        assert seen(1).value == pytest.approx(prepared(engine, same)(1).value, abs=2e-5), name


@pytest.mark.parametrize("engine", FOLLOWED)
def test_a_field_that_follows_may_need_all_rays(engine: str):
    """Where the lattice of the plan does not settle, the requested rays are traced, by a plan for so many."""
    seen = prepared(engine, air()).with_field(air(tilt=0.1))
    (make,) = seen.job.finer_runs
    run = make()
    assert follows(seen) and run.task.per_replicate == seen.job.quadrature.per_replicate == (1 << 17) // 16
    assert run.task.field.samples.samples is seen.field.samples.samples  # of a field that caches nothing for others
    many, few = run(1), seen.job.run(1)
    assert many.ray_count == 1 << 17 and few.ray_count < 1 << 14
    ratios = [abs(sums.phasors.sum() / sums.total[0]) ** 2 for sums in (many, few)]
    assert ratios[0] == pytest.approx(ratios[1], abs=4.0 * (many.standard_error + few.standard_error))


@pytest.mark.parametrize("engine", FOLLOWED)
def test_what_is_refused_leaves_the_memory_in_order(engine: str):
    """A field of another wavelength is refused as by a new estimate; the next field is right."""
    known = prepare_strehl(air(), DISC, wavelength=WAVE, ray_count=1 << 17, **on(engine))
    expected = known.with_field(air(tilt=0.1))(2).value
    with pytest.raises(ValueError, match=r"wavelength|no ray"):
        known.with_field(replace(air(), wavelength=1.064e-6))
    assert known.with_field(air(tilt=0.1))(2).value == expected


@pytest.mark.parametrize("engine", FOLLOWED)
def test_tables_and_wavelengths_are_those_of_each_field(engine: str):
    """What is cached on a field stays when the next one has the memory; another wavelength is another plan."""
    known = prepare_strehl(
        replace(air(), wavelength=WAVE), DISC, ray_count=1 << 17, allow_truncation=True, **on(engine)
    )
    fields = [replace(air(tilt=tilt), wavelength=WAVE) for tilt in (0.1, 0.2)]
    assert all(follows(known.with_field(field)) for field in fields)
    fresh = air(tilt=0.1).samples
    for found, expected in zip(roughness_of_blocks(fields[0].samples)[1], roughness_of_blocks(fresh)[1], strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12 * float(np.max(expected)))
    np.testing.assert_allclose(potential_by_blocks(fields[0].samples), potential_by_blocks(fresh), atol=1e-18)
    for limit in np.geomspace(1e-10, 1e-6, 9):
        boxes = [support_box(replace(air(), samples=grid), limit, None) for grid in (fields[0].samples, fresh)]
        np.testing.assert_array_equal(*boxes)
    red = replace(air(tilt=0.1), wavelength=1.5 * WAVE)
    other = known.with_field(red)
    alone = prepare_strehl(red, DISC, ray_count=1 << 17, allow_truncation=True, **on(engine))
    assert not follows(other) and other(1).value == pytest.approx(alone(1).value, abs=2e-5)
    assert other(1).value > known.with_field(fields[0])(1).value + 0.05


@pytest.mark.parametrize("engine", FOLLOWED)
def test_fields_and_their_memory_go_out_of_use(engine: str):
    """Neither the known field nor those that followed it are kept; what is prepared can be traced all the same."""
    known = prepared(engine, air())
    first = known.with_field(air(tilt=0.1))
    second = first.with_field(air(tilt=0.2))
    gone = [weakref.ref(each.field) for each in (known, first)]
    del known, first
    gc.collect()
    assert all(each() is None for each in gone) and 0.0 < second(1).value < 1.0
    rays = RayBundle.collimated(DISC, 50)
    alone = trace(air(tilt=0.2), rays, until=Plane((0.0, 0.0, 1.5), (0.0, 0.0, 1.0)), wavelength=WAVE, **on(engine))
    again = trace(second.field, rays, until=Plane((0.0, 0.0, 1.5), (0.0, 0.0, 1.0)), wavelength=WAVE, **on(engine))
    np.testing.assert_allclose(again.opd, alone.opd, atol=1e-4 * WAVE)
