"""Bounds of a field's derivatives that prove rays good: against closed forms and split-step waves."""

from dataclasses import replace

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Rectangle, Wavefront, split_step, validity, wavefront
from aerokernels.waves.bounds import change_bound
from tests.draws.wave_draws import draw_view, view_at_bound
from tests.random_fields import mesh_field, uniform_field

WAVELENGTH = 905e-9
LENGTH = 0.1


def air(shape, geometry: str = "planar", interpolation: str = "cubic", half: float = 6e-3) -> IndexField:
    """Contrast shape(y, z) over 12 mm and LENGTH: at rest at both ends."""
    y, z = np.linspace(0.0 if geometry == "axisymmetric" else -half, half, 81), LENGTH * np.linspace(0.0, 1.0, 81)
    envelope = np.sin(np.pi * z / LENGTH) ** 2
    return IndexField.from_samples(
        shape(y[:, None]) * envelope,
        origin=(y[0], 0.0),
        spacing=(y[1] - y[0], z[1]),
        geometry=geometry,
        interpolation=interpolation,
    )


def bound_of(field: IndexField, pupil=None):
    """The bound for a pupil of 2 mm at the field's front."""
    pupil = Disc(2e-3) if pupil is None else pupil
    return change_bound(field, pupil, np.array([0.0, 0.0, 1.0]), WAVELENGTH)


def traced_elsewhere(pupil, pixel_count: int) -> Wavefront:
    """A wavefront of noise of a wave, which no map resolves."""
    opd = np.random.default_rng(1).uniform(0.0, WAVELENGTH, (pixel_count, pixel_count))
    return Wavefront(opd, np.ones(opd.shape), 2.0 * max(pupil.half_extent) / pixel_count, WAVELENGTH, pupil=pupil)


@pytest.mark.parametrize(("geometry", "ways"), [("planar", 1.0), ("axisymmetric", 2.0)])
def test_the_bound_of_a_lens_is_its_curvature_times_its_distance(geometry: str, ways: float):
    """A parabola b y^2 / 2 sin^2 along z: the integral of z lap m is b LENGTH^2 / 4, twice that round about an axis.

    The spline of a parabola is one, and a B-spline's second moment along z moves the integral by 1e-4 of it.
    """
    rate = 1.0
    found = bound_of(air(lambda y: 0.5 * rate * y**2, geometry))
    assert found.curvature == pytest.approx(ways * rate * LENGTH**2 / 4.0, rel=2e-3)
    assert found.curvature < found.change


def test_a_tilt_is_no_disturbance():
    """A prism of a thousandth of a radian turns all light alike: nothing is left, to 1e-5 by single precision."""
    assert bound_of(air(lambda y: 2e-2 * y)).change < 1e-5
    assert bound_of(air(lambda y: 2e-2 * y + 0.1 * np.maximum(y, 0.0) ** 2)).change > 1e-4


def test_weak_air_of_any_interpolant_is_proven_and_strong_air_is_not():
    """Phase k m L / 2 of a contrast m over the box's diagonal; its square, whatever its features."""
    pupil = Disc(2e-3, (0.0, 0.0, -1e-3))
    for amplitude, proven in ((1e-8, True), (1e-6, False)):
        field = air(lambda y, amplitude=amplitude: amplitude * np.cos(2e4 * y), interpolation="linear")
        seen = traced_elsewhere(pupil, 4)
        told = validity(field, pupil, wavelength=WAVELENGTH, wavefront=seen)
        assert told.answered_by == ("bounds" if proven else "nobody")
        assert told.good is proven and told.decided is proven
        assert told.bound == pytest.approx((np.pi / WAVELENGTH * np.ptp(field.samples.samples) * 0.1007) ** 2, rel=2e-3)


@pytest.mark.parametrize("seed", [5000, 5004, 5014])
def test_what_the_bounds_just_prove_a_wave_confirms(seed: int):
    """Drawn shocks, turbulence and both, scaled to the edge of the proof: a wave differs from the rays by less.

    A 16-pixel map proves nothing by itself; 4e-4 is for the wave's own pixels. scripts/verdict --bounds draws more.
    """
    view = view_at_bound(draw_view(seed))
    assert view is not None
    seen = wavefront(view.field, view.pupil, wavelength=view.wavelength, pixel_count=16)
    told = validity(view.field, view.pupil, wavelength=view.wavelength, wavefront=seen)
    assert told.answered_by == "bounds" and told.good and told.crossed_share == 0.0
    assert 0.9 * told.limit < told.bound <= told.limit and "bounds" in told.reason
    rays = wavefront(view.field, view.pupil, wavelength=view.wavelength, pixel_count=64)
    wave = split_step(view.field, view.pupil, wavelength=view.wavelength, pixel_count=96, window=2.0, tolerance=1e-3)
    assert abs(wave.strehl() - rays.strehl()) < told.bound + 4e-4
    stronger = replace(view.field, samples=replace(view.field.samples, samples=1.2 * view.field.samples.samples))
    seen = wavefront(stronger, view.pupil, wavelength=view.wavelength, pixel_count=16)
    assert (
        validity(stronger, view.pupil, wavelength=view.wavelength, wavefront=seen, waves=False).answered_by == "nobody"
    )


def test_light_that_may_leave_the_box_is_not_bounded_by_what_is_in_it():
    """A pupil as wide as the box sees its faces, where the contrast ends: only what is weak altogether is proven."""
    field = air(lambda y: 1e-6 * np.cos(y / 3e-3))
    assert bound_of(field).change < 0.1
    assert bound_of(field, Disc(5.9e-3)).change > 0.1
    assert bound_of(field, Disc(5.9e-3)).curvature == np.inf


def test_nobody_asks_a_wave_that_costs_more_than_the_rays():
    """None beside 16 rays; through sums over coefficients beside a fine map, through a mesh beside a very fine one.

    The maps are noise, which no map resolves.
    """
    pupil = Rectangle(1e-3, 1e-3, (0.0, 0.0, -1e-3))
    for field, pixel_count, who in (
        (uniform_field("planar"), 4, "nobody"),
        (uniform_field("planar"), 32, "waves"),
        (mesh_field(), 32, "nobody"),
        (mesh_field(), 256, "waves"),
    ):
        seen = traced_elsewhere(pupil, pixel_count)
        never = validity(field, pupil, wavelength=WAVELENGTH, wavefront=seen, waves=False)
        assert never.answered_by == "nobody" and not never.good
        told = validity(field, pupil, wavelength=WAVELENGTH, wavefront=seen)
        assert told.answered_by == who
        if field.is_uniform:
            always = validity(field, pupil, wavelength=WAVELENGTH, wavefront=seen, waves=True)
            assert always.answered_by == "waves" and np.isfinite(always.strehl_change)
