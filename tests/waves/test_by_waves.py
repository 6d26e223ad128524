"""The verdict of a wave from its parts: window, slabs, rays, and what it tells of phases and crossings."""

import math

import numpy as np
import pytest
from scipy.fft import next_fast_len

from aerokernels import Body, Disc, IndexField, Rectangle
from aerokernels.waves.coarse_wave import _finest_of, _half_window, by_waves, finest_and_squares
from aerokernels.waves.diffraction import WaveAndRays, window_of
from aerokernels.waves.layers import span_of
from aerokernels.waves.screens import MapPaths, crossings_of, disturbance
from aerokernels.waves.shadows import SlabsPastBody, fringes, shadow_of
from aerokernels.waves.slabs import FINEST, LookingAlong, slabs_of

WAVELENGTH = 905e-9


def air(geometry: str, strength: float, body: Body | None = None) -> IndexField:
    """Waves of some millimetres in a box of 30 mm by 200 mm, at rest at its ends."""
    count = (24, 25, 21) if geometry == "volume" else (25, 21)
    axes = [np.linspace(-0.015, 0.015, n) for n in count[:-1]]
    z = np.linspace(0.0, 0.2, count[-1])
    places = np.meshgrid(*axes, z, indexing="ij")
    wave = sum(np.cos((700.0 + 300.0 * k) * place + k) for k, place in enumerate(places[:-1]))
    samples = strength * wave * np.sin(np.pi * places[-1] / 0.2) ** 2
    spacing = (*(axis[1] - axis[0] for axis in axes), z[1])
    return IndexField.from_samples(
        samples, origin=(*(axis[0] for axis in axes), 0.0), spacing=spacing, geometry=geometry, body=body
    )


@pytest.mark.parametrize("geometry", ["volume", "planar"])
@pytest.mark.parametrize("strength", [1e-6, 8e-6, 3e-5])
@pytest.mark.parametrize("feature", [None, 1.2e-3])
@pytest.mark.parametrize("traced", [None, 0.3])
def test_a_wave_is_compared_on_a_window_as_fine_as_the_finest_phase(
    geometry: str, strength: float, feature: float | None, traced: float | None
):
    """Three pixels to its half period, 48 or 32 to the pupil's half width at least, 256 to 512 of one column.

    Straight rays where more than a tenth of the pupil is near a focus, traced ones where rays cross.
    """
    field, flat = air(geometry, strength), geometry == "planar"
    pupil = Rectangle(9e-3, 8e-3, (0.0, 1e-3, -0.02)) if flat else Disc(5e-3, (1e-3, -5e-4, -0.02))
    reach = max(pupil.half_extent)
    begin, end = span_of(field, pupil.center, pupil.normal, pupil.axes, (-reach, reach), (-reach, reach))
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, _half_window(reach, WAVELENGTH, end, 0.0))
    slabs = slabs_of(field, look, begin, end, WAVELENGTH)
    half = _half_window(reach, WAVELENGTH, slabs.last, 0.0)
    least, most = (256, 512) if flat else (max(48, 32.0 * half / reach), slabs.most_pixels)
    finest = _finest_of(slabs, pupil, flat, WAVELENGTH) if feature is None else feature
    count = next_fast_len(math.ceil(max(min(6.0 * half / finest, most), least)))
    window = window_of(pupil, half, count, flat)
    distance = disturbance(field, pupil, pupil.normal).length
    path = slabs.paths(window.x, window.y, 1)[0]
    crossings = crossings_of(path[window.near], window.pixel, window.amplitude[window.near], distance)
    paths = None
    by_traced = False
    if traced is not None:
        place = np.linspace(-1.0, 1.0, 40)
        light = (np.hypot(place, place[:, None]) < 1.0).astype("f4")
        step = 0.12 * WAVELENGTH * (place > 0.0) * np.ones((40, 1))
        paths = MapPaths(step.astype("f4"), light, 2.0 * reach / 40, WAVELENGTH)
        by_traced = crossings.crossed > 0.0 or (crossings.near > 0.01 and finest >= 4.0 * paths.pixel)
    comparison = WaveAndRays(
        window, slabs, window.amplitude, slabs.first, end - slabs.last, WAVELENGTH, field.ambient_index,
        straight=crossings.near > 0.1, traced=None if paths is None else paths.strehl, by_traced=by_traced,
    )  # fmt: skip
    change, error = comparison.change(0.01)
    found = by_waves(field, pupil, WAVELENGTH, feature, 0.01, paths)
    assert found.strehl_change == pytest.approx(change, abs=1e-9)
    assert found.error == pytest.approx(error, abs=1e-9) or (math.isinf(error) and math.isinf(found.error))
    assert (found.feature, found.distance, found.curvature) == (finest, distance, crossings.curvature)
    assert found.crossed_share == crossings.crossed and found.answered_by == "waves" and found.limit == 0.01
    assert found.fresnel_number == pytest.approx(finest**2 / (WAVELENGTH * distance))
    assert found.blocked == 0.0 and found.rim_fresnel_number == math.inf
    # A phase that a map did not resolve is measured again on the window.
    again = by_waves(field, pupil, WAVELENGTH, finest, 0.01, None, resolved=False)
    seen = np.where(window.amplitude > 0.0, path, np.nan)
    assert again.feature == finest_and_squares(seen, window.pixel, WAVELENGTH)[0]


def test_a_wave_past_a_body_takes_the_finest_window_about_its_fringes():
    """With the most pixels, and the body's shadow; traced rays do not count."""
    body = Body(np.array([[2e-3, 0.08], [6e-3, 0.08], [6e-3, 0.12], [2e-3, 0.12]]), "planar")
    field, pupil = air("planar", 2e-6, body), Rectangle(9e-3, 8e-3, (0.0, 1e-3, -0.02))
    found = by_waves(field, pupil, WAVELENGTH, None, 0.01)
    reach, margin = 4.5e-3, fringes(field, WAVELENGTH)
    begin, end = span_of(field, pupil.center, pupil.normal, pupil.axes, (-reach, reach), (-reach, reach))
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, _half_window(reach, WAVELENGTH, end, margin))
    slabs = SlabsPastBody(field, look, begin, end, WAVELENGTH)
    window = window_of(pupil, _half_window(reach, WAVELENGTH, slabs.last, margin), 512, True)
    shadow, light = shadow_of(slabs, window, WAVELENGTH, end)
    assert found.blocked == pytest.approx(shadow.blocked) and 0.1 < shadow.blocked < 0.9
    assert found.rim_fresnel_number == pytest.approx(shadow.fresnel_number)
    comparison = WaveAndRays(
        window, slabs, light, slabs.first, end - slabs.last, WAVELENGTH, field.ambient_index, straight=False
    )
    assert found.strehl_change == pytest.approx(comparison.change(0.01)[0], abs=1e-7) and math.isnan(found.error)
    place = np.zeros((40, 40), dtype="f4")
    with_map = by_waves(field, pupil, WAVELENGTH, None, 0.01, MapPaths(place, place + 1.0, 1e-4, WAVELENGTH))
    assert with_map.strehl_change == found.strehl_change and FINEST == 64
