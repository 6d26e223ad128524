"""A pupil made ready once and traced many times: the same numbers as when it is made ready each time."""

import gc
import pickle
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from aerokernels import Disc, IndexField, estimate_strehl, prepare_strehl
from aerokernels.tracing.tasks.quadrature import ENOUGH

from ..backends import ENGINES, on


def lens(peak: float = 1e-6, fall: float = 12.0, count: int = 25) -> IndexField:
    """A blob in a volume that fades to nothing at the faces."""
    axis = np.linspace(-1.0, 1.0, count)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    contrast = peak * np.exp(-fall * (x**2 + 1.3 * y**2 + z**2)) * (1.0 + 0.3 * x)
    return IndexField.from_samples(contrast, origin=(-1.0,) * 3, spacing=(axis[1] - axis[0],) * 3, geometry="volume")


PUPIL = Disc(0.4, center=(0.0, 0.0, -1.5))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("remove", [("piston",), ("piston", "tilt")])
def test_each_call_is_an_estimate_of_its_own_seed(engine, remove):
    """The same bits as `estimate_strehl` with that seed, in any order; other seeds, other points."""
    options = {**on(engine), "ray_count": 16 * 300, "remove": remove, "allow_truncation": True}
    seen = prepare_strehl(lens(), PUPIL, **options)
    first, other, again = seen(seed=1), seen(seed=2), seen(seed=1)
    assert first.value == again.value and first.standard_error == again.standard_error
    assert first.value != other.value
    for seed, found in ((1, first), (2, other)):
        alone = estimate_strehl(lens(), PUPIL, seed=seed, **options)
        assert (alone.value, alone.standard_error, alone.opd_rms) == (found.value, found.standard_error, found.opd_rms)
        assert (alone.boresight == found.boresight).all() and alone.error == found.error
        assert alone.plan == found.plan == seen.plan


def test_a_field_does_not_outlive_the_pupil_that_was_made_ready_for_it():
    """A pupil made like the one before holds nothing of it: a sweep needs the memory of two cases."""
    seen = prepare_strehl(lens(), PUPIL, ray_count=1 << 17, allow_truncation=True)
    before = weakref.ref(seen.field)
    assert seen(0).traced_ray_count < 1 << 16
    seen = seen.with_field(lens(1.1e-6))
    gc.collect()
    assert seen(0).value < 1.0 and before() is None


def test_a_fan_is_prepared_too():
    """A symmetric set-up: the fan's points follow the seed."""
    axis = np.linspace(0.0, 1.0, 33)
    r, z = np.meshgrid(axis, axis, indexing="ij")
    contrast = 2e-6 * np.exp(-12.0 * (r**2 + 4.0 * (z - 0.5) ** 2))
    field = IndexField.from_samples(contrast, origin=(0.0, 0.0), spacing=(axis[1],) * 2, geometry="axisymmetric")
    options = {"ray_count": 16 * 400, "allow_truncation": True}
    seen = prepare_strehl(field, Disc(0.3, center=(0.0, 0.0, -0.5)), **options)
    assert any("radial quadrature by" in reason for reason in seen.plan.reasons)
    for seed in (4, 5, 4):
        alone = estimate_strehl(field, Disc(0.3, center=(0.0, 0.0, -0.5)), seed=seed, **options)
        assert seen(seed=seed).value == alone.value
    assert seen(seed=4).value != seen(seed=5).value


def blob(peak: float, fall: float = 12.0) -> IndexField:
    """An axisymmetric blob; where it falls off slowly there is a jump at the side of its box, r = 1."""
    axis = np.linspace(0.0, 1.0, 33)
    r, z = np.meshgrid(axis, axis, indexing="ij")
    contrast = peak * np.exp(-fall * r**2 - 48.0 * (z - 0.5) ** 2)
    return IndexField.from_samples(contrast, origin=(0.0, 0.0), spacing=(axis[1],) * 2, geometry="axisymmetric")


def test_new_values_of_a_symmetric_field_begin_with_fewer_rays():
    """16 x 128 rays give what 16 x 512 give within 1e-5; where their own error is above 3e-6, at a jump, more follow.

    Whatever was traced in between, and by whichever way the pupil was made ready for the values.
    """
    pupil = Disc(1.2, center=(0.0, 0.0, -0.5))
    options = {"ray_count": 16 * 1000, "allow_truncation": True}
    seen = prepare_strehl(blob(2e-6), pupil, **options)
    assert seen(seed=1).traced_ray_count == 16 * 512
    other = seen.with_field(blob(1.7e-6))
    few, many = other(seed=1), prepare_strehl(blob(1.7e-6), pupil, **options)(seed=1)
    assert few.traced_ray_count == 16 * 128 and few.standard_error <= ENOUGH < 1e-5
    assert any("radial quadrature by 16 x 128 rays" in reason for reason in few.plan.reasons)
    assert abs(few.value - many.value) <= 3.0 * few.standard_error + 1e-6 < 1e-5
    rough = other.with_field(blob(1.7e-6, fall=1.0))
    found = rough(seed=1)
    assert found.traced_ray_count >= 16 * (128 + 512)
    assert any("as at an edge: one of 16 x 512" in reason for reason in found.plan.reasons)
    again = rough.with_field(blob(1.7e-6))(seed=1)
    assert again.plan.sample_count >= few.plan.sample_count
    assert abs(again.value - few.value) <= 1e-6
    assert seen.with_field(blob(1.7e-6))(seed=1).value == few.value


def test_what_estimate_refuses_is_refused_when_it_is_prepared():
    with pytest.raises(TypeError, match="pupil must be a Disc"):
        prepare_strehl(lens(), 0.4)
    with pytest.raises(ValueError, match="ray_count must be a whole number"):
        prepare_strehl(lens(), PUPIL, ray_count=3)
    with pytest.raises(TypeError, match="rays"):
        prepare_strehl(lens(), PUPIL, rays=100)


@pytest.mark.parametrize("engine", ENGINES)
def test_many_fields_are_estimated_in_their_order_and_taken_as_they_are_needed(engine):
    """The same bits as one by one, two ahead at most; an error stands where its field stands."""
    options = {"ray_count": 16 * 300, "allow_truncation": True, **on(engine)}
    seen = prepare_strehl(lens(), PUPIL, **options)
    fields, taken = [lens(peak) for peak in (0.7e-6, 0.9e-6, 1.1e-6, 1.2e-6, 1.3e-6)], []

    def given():
        for number, field in enumerate(fields):
            taken.append(number)
            yield field

    alone = [seen.with_field(lens(peak))(seed=3).value for peak in (0.7e-6, 0.9e-6, 1.1e-6, 1.2e-6, 1.3e-6)]
    found = seen.for_fields(given(), seed=3)
    assert not taken
    assert next(found).value == alone[0] and len(taken) <= 2
    assert [each.value for each in found] == alone[1:]
    broken = seen.for_fields([fields[0], None, fields[1]], seed=3)
    assert next(broken).value == alone[0]
    with pytest.raises(TypeError, match="field must be an IndexField, got NoneType"):
        next(broken)
    assert next(broken, None) is None


@pytest.mark.parametrize("engine", ENGINES)
def test_threads_share_a_prepared_pupil(engine):
    """Eight threads, two fields, three seeds: each call has the bits of the same call alone."""
    seen = prepare_strehl(lens(), PUPIL, **on(engine), ray_count=16 * 300, allow_truncation=True)
    both = (seen, seen.with_field(lens(3e-6)))
    alone = [[one(seed=seed).value for seed in range(3)] for one in both]
    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda call: both[call % 2](seed=call % 3).value, range(24)))
    assert found == [alone[call % 2][call % 3] for call in range(24)]


def test_a_prepared_pupil_can_be_sent_to_another_process():
    """Pickled and read again it gives the same bits."""
    seen = prepare_strehl(lens(), PUPIL, ray_count=16 * 300, remove=("tilt",), allow_truncation=True)
    assert pickle.loads(pickle.dumps(seen))(seed=5).value == seen(seed=5).value
