"""Parts of an echo by hand: times of a record, noise of a low-pass, factors over a target, errors of ranges."""

import math

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Rectangle
from aerokernels.echo.detector import detect, low_pass, low_pass_gain, memory_time, sample_times
from aerokernels.echo.noise import NoiseSources, excess_noise_factor, noise_bandwidth, sampled_noise_gain, white_noise
from aerokernels.echo.pupil_reduction import PupilSums, check_ahead, upper_half
from aerokernels.echo.radiometry import plane_echo_power, plane_target_echo, tilted_pulse_tau
from aerokernels.echo.range_error import summarise_ranges
from aerokernels.echo.return_paths import _lobatto, interpolate_polynomial, is_symmetric
from aerokernels.echo.target_points import _gauss_points, _resolving_counts, _width_at, seen_outline, target_points
from aerokernels.echo.vacuum import VacuumEcho
from aerokernels.echo.waveform import fewer_gaussians, sum_of_pulses
from aerokernels.scene import Scene
from aerokernels.tracing import Plane

LIGHT = 299_792_458.0
ELECTRON, BOLTZMANN = 1.602176634e-19, 1.380649e-23


def scene(**changes) -> Scene:
    return Scene.load("wind-tunnel-static", {"beam.ray_count": 64} | changes)


@pytest.mark.parametrize("bandwidth", [None, 4e7, 9e8])
@pytest.mark.parametrize("late", [0.0, 1e-10, -2e-9, 5e-9])
def test_times_of_a_record_take_in_all_of_the_pulses(bandwidth: float | None, late: float):
    """From the first pulse's support to the last one's and three times of the low-pass.

    Moved if light is late by more than a tenth of the pulse's timescale; eight powers to that and to the low-pass's.
    """
    given = scene(**({"detector.bandwidth": bandwidth} if bandwidth else {}), **{"target.tilt": 0.4})
    vacuum = VacuumEcho.of(given)
    path = vacuum.paths.path
    rate, tau = given.detector.sample_rate, vacuum.pulse.timescale
    later = path + 0.5 * LIGHT * late * np.linspace(0.5, 1.0, len(path))
    later[3] = np.nan
    time, fine, stride = vacuum.times(later)
    moved = [late * share for share in (np.linspace(0.5, 1.0, len(path)))]
    moved = [one for k, one in enumerate(moved) if k != 3]
    early, last = (one if abs(one) > 0.1 * tau else 0.0 for one in (min(moved), max(moved)))
    before, after = vacuum.pulse.support
    wide = given.detector.bandwidth
    start = 2.0 * path.min() / LIGHT + before + min(early, 0.0)
    stop = 2.0 * path.max() / LIGHT + after + (3.0 / wide if wide else 0.0) + max(last, 0.0)
    np.testing.assert_allclose(time, np.arange(math.floor(start * rate), math.ceil(stop * rate) + 1) / rate, rtol=1e-12)
    assert stride == max(1, math.ceil(8.0 * max(1.0 / tau, wide or 0.0) / rate))
    assert len(fine) == (len(time) - 1) * stride + 1
    np.testing.assert_allclose(fine[::stride], time, rtol=1e-12)
    np.testing.assert_array_equal(vacuum.times()[0], vacuum.times(path)[0])
    power = vacuum.power(time, 1e-9)
    expected = sum(
        peak * vacuum.pulse(time - 2.0 * one / LIGHT - 1e-9) for peak, one in zip(vacuum.point_power, path, strict=True)
    )
    np.testing.assert_allclose(power, expected, atol=1e-12 * expected.max())


def test_a_record_covers_its_ends():
    np.testing.assert_allclose(sample_times(0.21, 0.58, 10.0), [0.2, 0.3, 0.4, 0.5, 0.6])
    for wrong in ((0.5, 0.5), (0.6, 0.5)):
        with pytest.raises(ValueError, match="must end after"):
            sample_times(*wrong, 10.0)


def test_noise_of_a_diode_and_its_amplifier():
    """McIntyre's factor, shot noise of signal, background and dark current, Johnson's noise, the amplifier's."""
    assert excess_noise_factor(1.0, 0.3) == pytest.approx(1.0) and excess_noise_factor(20.0, 1.0) == pytest.approx(20.0)
    factor = 0.02 * 12.0 + 0.98 * (2.0 - 1.0 / 12.0)
    assert excess_noise_factor(12.0, 0.02) == pytest.approx(factor)
    sources = NoiseSources(0.6, 12.0, 0.02, 2e-8, 3e-10, 310.0, 2e3, 3e-12)
    thermal = 4.0 * BOLTZMANN * 310.0 / 2e3 + 9e-24
    assert sources.thermal_density == pytest.approx(
        thermal, rel=1e-9, abs=0.0
    ) and sources.amperes_per_watt == pytest.approx(7.2)
    for power in (0.0, 5e-7, -1e-7):
        primary = 0.6 * (max(power, 0.0) + 2e-8) + 3e-10
        shot = 2.0 * ELECTRON * 144.0 * factor * primary
        assert float(sources.density(power)) == pytest.approx(shot + thermal, rel=1e-9, abs=0.0)
    generator = np.random.default_rng(1)
    drawn = np.random.default_rng(1).standard_normal(3)
    density = np.array([4.0, 1.0, 9.0])
    np.testing.assert_allclose(white_noise(density, 0.5, generator), np.sqrt(density) * drawn)


@pytest.mark.parametrize(
    ("response", "order"), [("first-order", 1), ("bessel", 4), ("butterworth", 3), ("gaussian", 2)]
)
def test_noise_behind_a_low_pass(response: str, order: int):
    """Its bandwidth by a fine sum of the power gain; with sampling, the sum over all frequencies that are folded."""
    band, top = 3e7, 4.7e8
    frequency = top * (np.arange(400_000) + 0.5) / 400_000
    gain = np.abs(low_pass_gain(frequency, band, response, order)) ** 2
    assert noise_bandwidth(band, response, order, top) == pytest.approx(gain.mean() * top, rel=1e-5, abs=0.0)
    assert noise_bandwidth(band, response, order, 0.4 * band) == pytest.approx(
        gain[frequency < 0.4 * band].sum() * top / 4e5, rel=1e-4, abs=0.0
    )
    period = 1.0 / 9e7
    low = np.array([0.0, 1.1e7, 4.5e7])
    folds = 2_000 if response == "first-order" else 4
    folded = sum(np.abs(low_pass_gain(low + k / period, band, response, order)) ** 2 for k in range(-folds, folds + 1))
    found = sampled_noise_gain(low, period, band, response, order)
    np.testing.assert_allclose(found, np.sqrt(folded), rtol=2e-4 if response == "first-order" else 1e-12)
    single = sampled_noise_gain(low, period, band, "bessel", 1)
    np.testing.assert_allclose(single, sampled_noise_gain(low, period, band, "first-order", 1), rtol=1e-12)


@pytest.mark.parametrize(
    ("response", "order"), [("first-order", 1), ("butterworth", 2), ("butterworth", 3), ("gaussian", 1)]
)
def test_gains_of_low_passes(response: str, order: int):
    """1 / (1 + i f); products of Butterworth's quadratics; exp(-ln 2 / 2 f^2); and after its memory nothing is left."""
    f = np.array([0.0, 0.3, 1.0, 2.5])
    s = 1j * f
    expected = {
        ("first-order", 1): 1.0 / (1.0 + s),
        ("butterworth", 2): 1.0 / (s**2 + math.sqrt(2.0) * s + 1.0),
        ("butterworth", 3): 1.0 / ((s + 1.0) * (s**2 + s + 1.0)),
        ("gaussian", 1): np.exp(-0.5 * math.log(2.0) * f**2),
    }[response, order]
    np.testing.assert_allclose(low_pass_gain(2e7 * f, 2e7, response, order), expected, atol=1e-12)
    slowest = {("butterworth", 2): math.sqrt(0.5), ("butterworth", 3): 0.5, ("gaussian", 1): 4.0}.get(
        (response, order), 1.0
    )
    assert memory_time(2e7, response, order) == pytest.approx(math.log(1e16) / (2.0 * math.pi * 2e7 * slowest))
    draw = np.random.default_rng(2)
    power, period = draw.uniform(size=50), 2e-9
    padding = math.ceil(memory_time(2e7, response, order) / period)
    padded = np.append(power, np.zeros(padding))
    whole = np.fft.ifft(
        np.fft.fft(padded) * low_pass_gain(np.fft.fftfreq(len(padded), period), 2e7, response, order)
    ).real
    found = detect(period * np.arange(50), power, volts_per_watt=3.0, bandwidth=2e7, response=response, order=order)
    even = len(padded) % 2 == 0  # Nyquist's component has one sign with real transforms, two with complex ones
    np.testing.assert_allclose(found, 3.0 * whole[:50], atol=1e-2 if even else 1e-12)
    np.testing.assert_allclose(found, 3.0 * low_pass(padded, period, 2e7, response, order)[:50], atol=1e-12)


def test_bessel_poles_have_a_flat_delay():
    """Half of the power at the bandwidth, and a group delay that changes by less than 1e-3 up to a half of it."""
    for order in (2, 4, 7):
        gain = low_pass_gain(np.array([0.0, 1.0]), 1.0, "bessel", order)
        assert abs(gain[0]) == pytest.approx(1.0) and abs(gain[1]) ** 2 == pytest.approx(0.5, abs=1e-9)
        phase = np.unwrap(np.angle(low_pass_gain(np.linspace(0.0, 0.5, 501), 1.0, "bessel", order)))
        delay = -np.diff(phase)
        assert np.ptp(delay) < (0.15 if order == 2 else 5e-3) * delay.mean()


@pytest.mark.parametrize("count", [3, 5, 9])
def test_factors_are_polynomials_through_nodes(count: int):
    """Chebyshev-Lobatto nodes, on a line and on a square."""
    node = _lobatto(count)
    np.testing.assert_allclose(node, [-math.cos(math.pi * k / (count - 1)) for k in range(count)], atol=1e-15)
    draw = np.random.default_rng(count)
    place = draw.uniform(-1.0, 1.0, (12, 2))
    one = draw.normal(size=count)
    np.testing.assert_allclose(
        interpolate_polynomial(np.polyval(one, node), node, place[:, :1]), np.polyval(one, place[:, 0]), atol=1e-9
    )
    both = draw.normal(size=(count, count))
    table = np.polynomial.polynomial.polygrid2d(node, node, both)
    expected = np.polynomial.polynomial.polyval2d(place[:, 0], place[:, 1], both)
    np.testing.assert_allclose(interpolate_polynomial(table, node, place), expected, atol=1e-9)


def test_what_is_symmetric_about_the_axis():
    samples = np.full((5, 5), 1e-6)
    about = IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry="axisymmetric")
    flat = IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry="planar")
    faced, tilted = (Plane(np.zeros(3), np.array([0.0, s, -1.0]) / math.hypot(s, 1.0)) for s in (0.0, 1e-6))
    assert is_symmetric(about, faced, Disc(1e-3)) and not is_symmetric(about, tilted, Disc(1e-3))
    assert not is_symmetric(flat, faced, Disc(1e-3)) and not is_symmetric(about, faced, Rectangle(1e-3, 1e-3))
    start = np.array([[0.0, 1.0, 5.0], [1.0, 0.0, 5.0], [0.3, -1.0, 5.0], [0.2, 0.5, 5.0], [0.1, -1e-12, 5.0]])
    kept, weight = upper_half(start, np.array([0.1, 0.2, 0.3, 0.25, 0.15]))
    np.testing.assert_array_equal(kept, start[[0, 1, 3, 4]])
    np.testing.assert_allclose(weight, [0.2, 0.2, 0.5, 0.15])
    sums = PupilSums(np.array([0.5, 0.0, 1.0]), np.array([0.3 + 0.4j, 0.0, 0.6j]), 3, 0, 0.0)
    np.testing.assert_allclose(sums.strehl, [1.0, 0.0, 0.36])
    front = float(about.box[1][2])
    check_ahead(about, np.array([[0.0, 0.0, front + 2e-6]]))
    with pytest.raises(ValueError, match="into the flow's box"):
        check_ahead(about, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, front + 0.5e-6]]))


def test_gauss_points_and_widths_of_polygons():
    """At most 64 points to a piece: all of them integrate polynomials of their rule's degree."""
    for count in (1, 7, 64, 65, 200):
        node, weight = _gauss_points(count)
        pieces = math.ceil(count / 64)
        assert len(node) == pieces * math.ceil(count / pieces) and (np.diff(node) > 0.0).all()
        for power in range(min(2 * (len(node) // pieces), 9)):
            exact = 0.0 if power % 2 else 2.0 / (power + 1)
            assert weight @ node**power == pytest.approx(exact, abs=1e-12)
    outline = np.array([[0.0, 0.0], [3.0, 0.0], [4.0, 2.0], [1.0, 3.0]])
    left, right = _width_at(outline, np.array([0.5, 2.5]))
    np.testing.assert_allclose(left, [0.5 / 3.0, 2.5 / 3.0])
    np.testing.assert_allclose(right, [3.25, 2.5])


@pytest.mark.parametrize("changes", [{}, {"target.tilt": 0.9}, {"target.tilt": -0.5}])
def test_points_resolve_the_depth_of_a_target(changes: dict[str, float]):
    """Four points, pi / 2 apart of the mean, to what light travels both ways in a timescale: over the plane's slope."""
    given = scene(**{"target.width": 0.4, "target.height": 0.4, "beam.pulse_tau": 2e-10} | changes)
    outline = seen_outline(given)
    divergence = (1.0 - given.beam.exit_radius / given.beam.radius) / given.target.distance
    corner = given.target.corners
    np.testing.assert_allclose(outline, corner[:, :2] / (1.0 + divergence * corner[:, 2])[:, None])
    across, along = _resolving_counts(given, outline)
    step = 0.5 * LIGHT * 2e-10 / (0.5 * math.pi * 4.0)
    normal = given.target.orientation[:, 2]
    x, y = (
        axis.ravel()
        for axis in np.meshgrid(*(np.linspace(*(f(outline[:, a]) for f in (np.min, np.max)), 9) for a in (0, 1)))
    )
    ratio = given.beam.exit_radius / given.beam.radius
    distance = given.target.distance
    ray = np.column_stack([x * (1.0 - ratio), y * (1.0 - ratio), np.full(len(x), distance)])
    start = np.column_stack([ratio * x, ratio * y, np.zeros(len(x))])
    path = np.linalg.norm(ray, axis=1) * ((np.array([0.0, 0.0, distance]) - start) @ normal) / (ray @ normal)
    fit = np.linalg.lstsq(np.column_stack([np.ones(len(x)), x, y]), path, rcond=None)[0]
    rest = np.ptp(path - fit[0] - fit[1] * x - fit[2] * y)
    for count, slope, reach in zip((across, along), fit[1:], np.ptp(outline, axis=0), strict=True):
        assert count == pytest.approx((abs(slope) * reach + rest) / step, rel=0.12, abs=1.5)
    points = target_points(given)
    radius = given.beam.radius
    assert points.weight.max() <= 2.0 / (math.pi * radius**2) * (0.4 * 0.4)
    np.testing.assert_allclose(points.start[:, :2], ratio * points.aim[:, :2])


def test_few_gaussians_add_up_to_many():
    """Pulses close together against their width: the same sum to rounding; far apart they stay as they are."""
    draw = np.random.default_rng(3)
    delay, peak = 5.0 + 0.3 * draw.uniform(-1.0, 1.0, 400), draw.uniform(0.5, 1.0, 400)
    few, heights = fewer_gaussians(delay, peak, 1.0)
    assert 4 < len(few) < 33
    time = np.linspace(0.0, 10.0, 201)
    sums = [np.exp(-np.square(time[:, None] - d)) @ p for d, p in ((delay, peak), (few, heights))]
    np.testing.assert_allclose(sums[1], sums[0], atol=1e-12 * peak.sum())
    same = fewer_gaussians(30.0 * delay, peak, 1.0)
    np.testing.assert_array_equal(same[0], 30.0 * delay)
    alike, total = fewer_gaussians(np.full(40, 2.0), np.ones(40), 1.0)
    np.testing.assert_allclose(alike, 2.0)
    assert total.sum() == pytest.approx(40.0)
    late = sum_of_pulses(np.array([0.0, 9.1, 30.0]), np.array([0.0]), np.array([2.0]), 1.0)
    assert late[0] == pytest.approx(2.0) and late[2] == 0.0


@pytest.mark.parametrize("tilt", [0.0, 0.5, -0.7])
@pytest.mark.parametrize("limits", [{}, {"width": 0.05}, {"height": 0.04}, {"limits": "paper"}])
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_the_echo_of_a_plane_by_a_fine_sum(tilt: float, limits: dict, share: float):
    """Eq 8 over a lattice of the beam, in closed form and by quadrature; the reflectance by Phong's formula."""
    tau, radius, distance = 3e-10, 0.03, 1.7
    given = {
        "peak_power": 60.0, "receiver_diameter": 0.02, "beam_radius": radius, "distance": distance, "tilt": tilt,
        "pulse_tau": tau, "reflectivity": 0.4, "atmospheric_transmission": 0.9, "system_efficiency": 0.8, "strehl": 0.7,
        "specular_share": share, "specular_exponent": 5.0,
    }  # fmt: skip
    time = 2.0 * distance / LIGHT + np.array([-4e-10, 0.0, 1e-10, 7e-10])
    half_x = 0.5 * limits["width"] if "width" in limits else 3.6 * radius
    half_y = (
        radius
        if "limits" in limits
        else 0.5 * limits["height"] * math.cos(tilt)
        if "height" in limits
        else 3.6 * radius
    )
    x, y = (half * (2.0 * (np.arange(4000) + 0.5) / 4000 - 1.0) for half in (half_x, half_y))
    across = np.exp(-2.0 * (x / radius) ** 2).mean() * 2.0 * half_x
    late = time[:, None] - 2.0 * (distance + y * math.tan(tilt)) / LIGHT
    along = (np.exp(-2.0 * (y / radius) ** 2) * np.exp(-((late / tau) ** 2))).mean(axis=1) * 2.0 * half_y
    lobe = share * 6.0 / (2.0 * math.pi) * max(math.cos(2.0 * tilt), 0.0) ** 5
    reflectance = 0.4 * ((1.0 - share) / math.pi + lobe)
    aperture = math.pi * 0.02**2 / 4.0
    peak = 60.0 * reflectance * math.cos(tilt) * aperture / distance**2 * 0.81 * 0.8 * 0.7
    expected = peak * 2.0 / (math.pi * radius**2) * across * along
    if share:
        bare = plane_target_echo(time, **{**given, "specular_share": 0.0}, **limits)
        ratio = plane_target_echo(time, **given, **limits) / bare
        assert np.ptp(ratio) < 1e-9
        return
    for evaluation in ("closed-form", "quadrature"):
        found = plane_target_echo(time, **given, **limits, evaluation=evaluation)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7 * peak)
    spread = math.sqrt(2.0) * radius * math.tan(tilt) / LIGHT
    assert tilted_pulse_tau(tau, radius, tilt) == pytest.approx(math.hypot(tau, spread))
    assert plane_echo_power(2.0, 0.1, 3.0, 0.5, 0.3, 0.5, 0.7) == pytest.approx(
        2.0 * 0.3 * 0.5 * math.pi * 0.01 / 4.0 / 9.0 * 0.25 * 0.7
    )


def test_statistics_of_ranges_by_their_distributions():
    from scipy import stats

    ranges = np.random.default_rng(4).normal(1.5, 0.02, 23)
    found = summarise_ranges(list(ranges), 30, 1.49, 0.01, 0.9)
    spread, count = ranges.std(ddof=1), 23
    assert found.systematic_error == pytest.approx(ranges.mean() - 1.49) and found.random_error == pytest.approx(spread)
    assert found.missed_count == 7 and found.trial_count == 30 and found.cramer_rao_bound == 0.01
    assert found.systematic_standard_error == pytest.approx(spread / math.sqrt(count))
    assert found.random_standard_error == pytest.approx(spread / math.sqrt(2.0 * (count - 1)))
    reach = stats.t.ppf(0.95, count - 1) * spread / math.sqrt(count)
    assert found.systematic_interval == pytest.approx((ranges.mean() - 1.49 - reach, ranges.mean() - 1.49 + reach))
    tails = stats.chi2.ppf([0.95, 0.05], count - 1)
    assert found.random_interval == pytest.approx(tuple(spread * np.sqrt((count - 1) / tails)))
    with pytest.raises(ValueError, match="29 of 30 trials gave no range"):
        summarise_ranges([1.0], 30, 1.49, 0.01, 0.9)
    assert summarise_ranges([1.0, 2.0], 2, 1.0, 0.01, 0.9).systematic_error == 0.5
