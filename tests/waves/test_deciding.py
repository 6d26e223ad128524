"""Who decides on ray optics, condition by condition, at the numbers where each of them turns."""

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from aerokernels import Annulus, Body, Disc, IndexField, Mask, Rectangle, Wavefront
from aerokernels.waves.bounds import ChangeBound
from aerokernels.waves.screens import Crossings, Disturbance, MapPaths, ScreensAnswer, paths_of
from aerokernels.waves.shadows import fringes, is_clear
from aerokernels.waves.slabs import is_summed
from aerokernels.waves.validity import affordable, by_bounds, by_rays
from aerokernels.waves.verdict import Validity
from tests.phase_plates import WAVELENGTH
from tests.random_fields import mesh_field, uniform_field

deciding = importlib.import_module("aerokernels.waves.validity")  # the package has a function of that name
UP = np.array([0.0, 0.0, 1.0])
PUPIL = Disc(2e-3, (0.0, 0.0, -1e-3))


def seen(count: int = 64, **options) -> Wavefront:
    """A flat wavefront over the pupil."""
    place = np.arange(count) - 0.5 * (count - 1)
    weight = (np.hypot(place, place[:, None]) < 0.5 * count).astype(float)
    return Wavefront(np.zeros((count, count)), weight, 4e-3 / count, WAVELENGTH, pupil=PUPIL, **options)


def strehl_of(paths: MapPaths, value: float) -> MapPaths:
    """Paths of two heights whose Strehl ratio is a given one."""
    high = np.zeros(paths.path.shape, dtype=np.float32)
    lit = np.flatnonzero(paths.light > 0.0)
    high.flat[lit[: len(lit) // 2]] = math.acos(2.0 * value - 1.0) / (2.0 * np.pi) * WAVELENGTH
    made = replace(paths, path=high)
    assert made.strehl == pytest.approx(value, abs=1e-3)
    return made


@pytest.fixture
def decided(monkeypatch: pytest.MonkeyPatch):
    """The verdict of rays for given lengths and a given answer of the two screens, which have tests of their own."""

    def decide(
        wave: Wavefront | None = None, feature: float = 1e-3, length: float = 0.1, until: float = 0.1,
        change: float = 1e-3, strehl: float = 1.0, limit: float = 0.01, wavelength: float = WAVELENGTH,
    ) -> Validity | None:  # fmt: skip
        wave = seen() if wave is None else wave
        monkeypatch.setattr(deciding, "disturbance", lambda *_: Disturbance(length, until))
        answer = ScreensAnswer(change, length, Crossings(0.0, 0.2, 0.0))
        monkeypatch.setattr(deciding, "screens_answer", lambda *_: answer)
        paths = strehl_of(paths_of(wave), strehl)
        return by_rays(uniform_field("volume"), PUPIL, UP, wave, paths, wavelength, feature, limit)

    return decide


def test_rays_decide_by_themselves_where_all_conditions_hold(decided):
    found = decided()
    assert found.answered_by == "rays" and found.decided and found.good and bool(found)
    assert (found.strehl_change, found.feature, found.distance, found.curvature) == (1e-3, 1e-3, 0.1, 0.2)
    assert found.fresnel_number == pytest.approx(1e-6 / (WAVELENGTH * 0.1)) and found.limit == 0.01
    assert found.crossed_share == 0.0 and math.isnan(found.error)


def test_rays_of_other_light_do_not_decide(decided):
    """Another wavelength, more than a thousandth blocked, or a term removed that changes where rays cross."""
    assert decided(wavelength=1.01 * WAVELENGTH) is None
    assert decided(seen(blocked=0.00101)) is None and decided(seen(blocked=0.00099)) is not None
    assert decided(seen(removed=("piston", "tilt", "Z1", "Z2", "Z3"))) is not None
    for term in ("focus", "Z4"):
        assert decided(seen(removed=("piston", term))) is None


def test_the_pixels_of_the_screens_resolve_the_finest_phase(decided):
    """Four of them to a half period: of the map's own, or of every second pixel of a map of more than 64."""
    assert decided(feature=3.99 * 4e-3 / 64, length=1e-3) is None
    assert decided(feature=4.01 * 4e-3 / 64, length=1e-3) is not None
    assert decided(seen(128), feature=7.99 * 4e-3 / 128, length=1e-3) is None
    assert decided(seen(128), feature=8.01 * 4e-3 / 128, length=1e-3) is not None


def test_light_that_has_spread_or_changed_its_shape_needs_a_wave(decided):
    """Fresnel numbers: the pupil's times limit and Strehl ratio (0.25 at least) from 0.16 on, the phase's from 4 on."""
    until = lambda number: 4e-6 / WAVELENGTH / number  # noqa: E731
    for strehl in (0.5, 1.0):
        assert decided(until=until(0.159 / 0.01 / strehl), strehl=strehl) is None
        assert decided(until=until(0.161 / 0.01 / strehl), strehl=strehl) is not None
    for number, limit, good in ((63.0, 0.01, False), (65.0, 0.01, True), (31.0, 0.02, False), (33.0, 0.02, True)):
        assert (decided(until=until(number), strehl=0.1, limit=limit) is not None) is good
    assert decided(length=1e-6 / WAVELENGTH / 3.99) is None
    assert decided(length=1e-6 / WAVELENGTH / 4.01) is not None


def test_the_change_of_the_screens_is_far_below_the_limit(decided):
    """Below 0.3 of it, of either sign."""
    for change, good in ((0.0031, False), (0.0029, True), (-0.0031, False), (-0.0029, True), (math.nan, False)):
        assert (decided(change=change) is not None) is good


def test_bounds_prove_what_is_below_the_limit_and_a_tenth(monkeypatch: pytest.MonkeyPatch):
    field = uniform_field("volume")
    for change, limit, wave, good in (
        (0.009, 0.01, seen(), True),
        (0.01, 0.01, seen(), True),
        (0.0101, 0.01, seen(), False),
        (0.1, 0.5, seen(), True),
        (0.11, 0.5, seen(), False),
        (0.001, 0.01, seen(blocked=0.00101), False),
        (0.001, 0.01, seen(blocked=0.00099), True),
        (0.001, 0.01, replace(seen(), wavelength=1.01 * WAVELENGTH), False),
        (math.nan, 0.01, seen(), False),
    ):
        monkeypatch.setattr(deciding, "change_bound", lambda *_, change=change: ChangeBound(change, 0.3, 0.2))
        found = by_bounds(field, PUPIL, UP, wave, WAVELENGTH, limit)
        assert found.good is good and found.decided is good and found.limit == limit
        if good:
            assert (found.strehl_change, found.distance, found.curvature) == (0.0, 0.2, 0.3)
            assert found.bound == change and found.answered_by == "bounds" and found.crossed_share == 0.0
        elif wave.blocked > 1e-3 or wave.wavelength != WAVELENGTH:
            assert found.bound == math.inf


def test_what_a_wave_beside_a_wavefront_may_cost():
    """A map of 32 pixels at least; sums over coefficients then, and layers from 800,000 cells times rays on."""
    assert not affordable(uniform_field("volume"), UP, seen(31)) and affordable(uniform_field("volume"), UP, seen(32))
    mesh = mesh_field()
    low, high = mesh.box
    cells = math.hypot(*(high - low)[1:]) / float(mesh.spacing.min())
    lit = 8e5 / cells
    side = math.ceil(math.sqrt(lit)) + 2
    for count, worth in ((math.ceil(lit * 0.999), False), (math.ceil(lit * 1.001), True)):
        weight = np.zeros(side * side)
        weight[:count] = 1.0
        wave = Wavefront(np.zeros((side, side)), weight.reshape(side, side), 4e-3 / side, WAVELENGTH)
        assert affordable(mesh, UP, wave) is worth
    slanted = np.array([0.1, 0.0, 1.0]) / math.sqrt(1.01)
    assert not is_summed(uniform_field("volume"), slanted) and is_summed(uniform_field("volume"), -UP)
    assert not affordable(uniform_field("volume"), slanted, seen(32))


def test_pupils_of_the_same_light():
    """The same place and direction, and the same transmission of 32 pixels across."""
    one = Disc(2e-3, (1e-3, 2e-3, 3e-3), (0.1, 0.0, 1.0))
    assert deciding._same_light(one, one) and deciding._same_light(one, replace(one))
    for other in (
        replace(one, center=np.array([1e-3, 2e-3, 3.001e-3])),
        replace(one, normal=np.array([0.1001, 0.0, 1.0])),
        replace(one, radius=2.0001e-3),
        Annulus(2e-3, 0.5e-3, one.center, one.normal),
        Rectangle(4e-3, 4e-3, one.center, one.normal),
    ):
        assert not deciding._same_light(one, other)
    values = np.random.default_rng(1).uniform(0.5, 1.0, (8, 8))
    masks = [Mask(values * (1.0 + change), 5e-4) for change in (0.0, 0.5e-6, 3e-6)]
    assert deciding._same_light(masks[0], masks[1]) and not deciding._same_light(masks[0], masks[2])


@pytest.mark.parametrize("edge", [0.9, 1.1])
def test_a_pupil_is_clear_of_a_body_by_four_widths_of_fringes(edge: float):
    """Widths sqrt(lambda L), with L the diagonal of the box, beside the pupil."""
    size = math.hypot(0.04, 0.05)
    beside = 4.0 * math.sqrt(WAVELENGTH * size)
    low = 2e-3 + edge * beside
    z, y = np.linspace(0.0, 0.05, 11), np.linspace(-0.02, 0.02, 9)
    body = Body(np.array([[low, 0.01], [low + 2e-3, 0.01], [low + 2e-3, 0.03], [low, 0.03]]), "planar")
    field = IndexField.from_samples(
        1e-6 * np.ones((9, 11)), origin=(y[0], 0.0), spacing=(y[1] - y[0], z[1]), geometry="planar", body=body
    )
    assert fringes(field, WAVELENGTH) == pytest.approx(beside)
    assert is_clear(field, PUPIL, UP, WAVELENGTH) is (edge > 1.0)
    assert is_clear(uniform_field("volume"), PUPIL, UP, WAVELENGTH)


def test_verdicts_are_good_up_to_their_limit():
    for change, good in ((0.01, True), (-0.01, True), (0.0101, False), (-0.0101, False), (math.nan, False)):
        assert Validity(strehl_change=change, limit=0.01).good is good
    assert not Validity(answered_by="nobody").decided
    told = Validity(strehl_change=0.02, crossed_share=0.034, error=1e-3, blocked=0.12, rim_fresnel_number=33.0)
    for part in ("not good", "+0.0200 +- 0.0010", "cross over 3.4 %", "12 % of the light", "Fresnel number of 33"):
        assert part in told.reason
    assert "finest phase is 2.5" in Validity(strehl_change=0.02, crossed_share=0.0, fresnel_number=2.5).reason
    assert "+-" not in Validity(strehl_change=0.02, crossed_share=0.0, fresnel_number=2.5).reason
