"""Air that fades out at a whole face of its box has lost nothing there; air that continues is found as before.

Truth: the same air in a longer box. On straight rays along z the optical path is the sum of the samples times the
distance of nodes (the trapezoidal rule, exact for the cubic spline up to its ends), so what continues is known.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerokernels import Disc, IndexField, estimate_strehl, optical_series, trace
from aerokernels.flow import open_series
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus
from aerokernels.tracing.error_budget.face_shares import face_shares
from aerokernels.tracing.error_budget.known_air import may_be_lost
from aerokernels.tracing.error_budget.tails import tails
from aerokernels.tracing.lines import FACES, SIDE

from .known_air_boxes import GEOMETRIES, UP, WAVE

ACROSS, ALONG, CELL = 24, 32, 1e-3
CONTRAST = 2e-5
HIGH_Z = FACES.index("high z")
FAR = Plane((0.0, 0.0, 0.2), UP)
# Well inside the side faces, which are disturbed.
PUPIL = Disc(6e-3, (0.0, 0.0, -1e-3))


def field_of(samples: np.ndarray, geometry: str = "volume") -> IndexField:
    """Samples at nodes 1 mm apart, from z = 0 on, about the axis."""
    origin = [-0.5 * CELL * (count - 1) for count in samples.shape[:-1]] + [0.0]
    if geometry == "axisymmetric":
        origin[0] = 0.0
    return IndexField.from_samples(samples, origin=origin, spacing=[CELL] * samples.ndim, geometry=geometry)


def turbulence(seed: int = 3) -> np.ndarray:
    """Random air, smooth over four cells, of the rms CONTRAST."""
    shape = ACROSS, ACROSS, ALONG
    waves = np.meshgrid(*(np.fft.fftfreq(count) for count in shape), indexing="ij")
    noise = np.random.default_rng(seed).normal(size=shape)
    made = np.fft.ifftn(np.fft.fftn(noise) * np.exp(-200.0 * sum(wave**2 for wave in waves))).real
    return CONTRAST * made / made.std()


def window(count: int = ALONG) -> np.ndarray:
    """Hann's window: 0 at both ends, with its slope."""
    return np.sin(np.pi * np.arange(count) / (count - 1)) ** 2


def lost(field: IndexField, rays: RayBundle) -> np.ndarray:
    return may_be_lost(field, rays, FAR, 1e-3 * WAVE)[0]


def test_turbulence_in_a_window_ends_there():
    """Every ray arrives, the pupil is accepted, and the same samples with quiet air beyond give the same OPD."""
    samples = turbulence() * window()
    field, longer = field_of(samples), field_of(np.pad(samples, ((0, 0), (0, 0), (0, 8))))
    rays = RayBundle.collimated(PUPIL, 500)
    found, truth = (trace(each, rays, until=FAR) for each in (field, longer))
    assert (found.status == RayStatus.OK).all() and (truth.status == RayStatus.OK).all()
    assert np.abs(found.opd - truth.opd).max() < 1e-3 * WAVE
    assert estimate_strehl(field, PUPIL, wavelength=WAVE).error["truncation"] < 5e-3
    cut = field_of((turbulence() * window())[..., :-8])
    assert (trace(cut, rays, until=FAR).status == RayStatus.LEFT_DISTURBED_AIR).mean() > 0.9
    with pytest.raises(ValueError, match="looks through disturbed air that ends at the face z = "):
        estimate_strehl(cut, PUPIL, wavelength=WAVE)


def test_a_series_in_a_window_gives_no_warning(recwarn):
    density = [1.2 + 1e3 * turbulence(seed) * window() for seed in range(3)]
    half = 0.5 * CELL * (ACROSS - 1)
    series = open_series(
        density,
        time_step=1e-5,
        geometry="volume",
        origin=(-half, -half, 0.0),
        spacing=(CELL,) * 3,
        ambient_density=1.2,
    )
    maps = optical_series(series, PUPIL, pixel_count=16)
    assert float(maps.known.min()) == 1.0
    assert not [each for each in recwarn if "disturbed air" in str(each.message)]


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_a_zero_of_waves_that_continue_is_no_end(geometry):
    """sin(k z) that is 0 over the whole face: what continues up to the next zero is counted, as without the face."""
    along = np.arange(ALONG) - (ALONG - 1)
    wave = CONTRAST * np.sin(2.0 * np.pi * along / 24.0)
    samples = np.ones((ACROSS,) * (2 if geometry == "volume" else 1))[..., None] * wave
    field = field_of(samples, geometry)
    assert face_shares(field)[HIGH_Z] == 1.0
    half_wave = CONTRAST * 24.0 * CELL / np.pi
    found = lost(field, RayBundle([[0.0, 1e-3, -1e-3], [0.0, 2e-3, -1e-3]], UP))
    assert (found > 0.1 * half_wave).all()


def test_a_jet_through_the_end_of_a_window_is_found():
    """A column of 2 x 2 cells, ten times weaker than the turbulence about it, goes on: its own rays lose as much."""
    samples = turbulence() * window()
    middle = ACROSS // 2
    samples[middle - 1 : middle + 2, middle - 1 : middle + 2] += 0.1 * CONTRAST
    field = field_of(samples)
    inside = RayBundle([[0.5 * CELL, 0.5 * CELL, -1e-3]], UP)
    assert lost(field, inside)[0] >= 0.1 * CONTRAST * CELL
    aside = RayBundle([[6e-3, 6e-3, -1e-3]], UP)
    assert lost(field, aside)[0] < 1e-3 * WAVE


@given(
    geometry=st.sampled_from(GEOMETRIES),
    length=st.floats(0.4, 12.0),
    power=st.sampled_from([1.0, 1.5, 2.0]),
    depth=st.floats(0.1, 3.0),
)
def test_no_tail_is_told_to_be_less_than_it_is(geometry, length, power, depth):
    """Tails exp(-(x / L)^p), cut at a depth of so many L: the sum of the samples that are cut off.

    They decay at least as fast beyond the face as just inside it, which is what is assumed.
    """
    x = (np.arange(ALONG + 400) + depth * length) - (ALONG - 1)
    tail = CONTRAST * np.exp(-((np.maximum(x, 0.0) / length) ** power))
    samples = np.ones((ACROSS,) * (2 if geometry == "volume" else 1))[..., None] * tail[:ALONG]
    truth = CELL * (tail[ALONG - 1 :].sum() - 0.5 * tail[ALONG - 1])
    found = lost(field_of(samples, geometry), RayBundle([[0.0, 1e-3, -1e-3]], UP))[0]
    if truth > 1e-3 * WAVE:
        assert found > truth


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_air_of_a_ray_at_its_own_end_counts_in_full(share):
    """Random samples about a ray along nodes: the greater of its last sample and the share of its last three."""
    samples = CONTRAST * np.random.default_rng(1).uniform(-1.0, 1.0, (5, 5, 9))
    field = field_of(samples)
    point, inward = np.array([[0.0, 0.0, 8 * CELL]]), np.array([[0.0, 0.0, -1.0]])
    ((found, _),) = tails(field, point, inward, np.array([8 * CELL]), share=share)
    last = np.abs(samples[2, 2, -3:])
    assert 0.3 * last.max() < last[2] < last.max()
    assert found[0] == pytest.approx(max(last[2], share * last.max()), rel=1e-12)


def test_shares_are_of_the_faces():
    """Homogeneous air: all of it. Turned and mirrored samples: the same numbers at the turned and mirrored faces."""
    everywhere = face_shares(field_of(turbulence()))
    assert everywhere[:SIDE].tolist() == [1.0] * SIDE
    samples = turbulence() * window() ** 0.75
    shares = face_shares(field_of(samples))
    assert shares[HIGH_Z] < 0.9
    assert face_shares(field_of(samples[..., ::-1]))[HIGH_Z - 1] == shares[HIGH_Z]
    assert face_shares(field_of(1e-3 * samples))[HIGH_Z] == pytest.approx(shares[HIGH_Z], rel=1e-12)
    turned = np.ascontiguousarray(np.moveaxis(samples, 2, 0))
    assert face_shares(field_of(turned))[1] == pytest.approx(shares[HIGH_Z], rel=1e-12)
    assert face_shares(field_of(np.zeros((4, 4, 4)))).tolist() == [1.0] * len(FACES)
    assert face_shares(field_of(np.full((4, 4, 2), CONTRAST)))[HIGH_Z] == 1.0
