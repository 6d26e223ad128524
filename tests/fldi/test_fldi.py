"""A focused laser differential interferometer against Schmidt and Shepherd's transfer function, and what it refuses.

Set-up: sine waves along the beams' separation in a sheet whose strength is a bell of 0.2 mm along the beams, 32 samples
to a wave. Formula: phase = k path K s H, with H the closed form's mean over the bell. Error sources: the spline's slope
at 32 samples to a wave, (K h)^4 / 180 = 8e-6; rays of the beam, below 1e-6. Tolerance: 1e-3 of the greatest response.
"""

import warnings

import numpy as np
import pytest

from aerokernels import FLDI, IndexField, fldi_response
from aerokernels.tracing.pupil.air import TruncationWarning
from tests.draws.fldi_draws import check_reading, draw_reading
from tests.slow import first_of

THICKNESS, STRENGTH = 2e-4, 1e-7


def sheet(wave_number: float, distance: float, instrument: FLDI, phase: float = 0.0, room: float = 0.0) -> IndexField:
    """Waves along y about z = distance, wide enough for both beams."""
    step = 2.0 * np.pi / wave_number / 32
    half = 3.0 * float(instrument.radius(distance)) + instrument.separation + room
    count = int(np.ceil(half / step)) + 8
    y = step * np.arange(-count, count + 1)
    z = np.linspace(-0.75, 0.75, 25) * THICKNESS
    contrast = STRENGTH * np.sin(wave_number * y + phase)[:, None] * bell(z)
    return IndexField.from_samples(
        contrast, origin=(y[0], distance + z[0]), spacing=(step, z[1] - z[0]), geometry="planar"
    )


def bell(z: np.ndarray) -> np.ndarray:
    return np.where(np.abs(z) < 0.5 * THICKNESS, np.cos(np.pi * z / THICKNESS) ** 4, 0.0)


@pytest.mark.parametrize(
    ("distance", "focus"), first_of([(-0.004, 0.3), (0.05, 0.0), (0.0, 0.0), (-0.004, 0.0), (0.05, 0.3), (0.0, 0.3)])
)
def test_sine_waves_at_any_place(distance: float, focus: float):
    """Wave numbers of three decades; at (x, y, z) of the focus, in front of it and behind."""
    instrument = FLDI(120e-6, 6e-6, focus=(0.01, 0.0, focus), direction=(0.0, 1.0, 0.0))
    z = np.linspace(-0.5, 0.5, 201) * THICKNESS
    for wave_number in np.geomspace(30.0, 3e4, 4):
        field = sheet(wave_number, focus + distance, instrument)
        found = fldi_response(field, instrument)
        path = STRENGTH * 0.375 * THICKNESS
        slope = 2.0 * np.pi / instrument.wavelength * path * wave_number * instrument.separation
        expected = np.average(instrument.transfer(wave_number, distance + z), weights=bell(z))
        assert abs(float(found.phase) / slope - expected) < 1e-3, wave_number
        if expected > 1e-2:
            assert float(found.phase) / slope == pytest.approx(expected, rel=1e-3)
        assert float(found.error) / slope < 2e-3  # one and a half times what the field's own nodes may leave


def test_closed_forms_agree():
    """The mean over distances of H is the closed form with the error function; a wave across sees no separation."""
    instrument = FLDI(1e-4, 5e-6)
    wave_number = np.geomspace(1.0, 1e5, 21)
    z = np.linspace(-0.02, 0.02, 200_001)
    for index in (3, 10, 15, 20):
        mean = np.trapezoid(instrument.transfer(wave_number[index], z), z) / 0.04
        assert instrument.transfer_through(wave_number[index], 0.02) == pytest.approx(mean, rel=1e-5, abs=1e-12)
    for one in (instrument.transfer, instrument.transfer_through):  # waves that run the other way, as an FFT has them
        assert np.array_equal(one(-wave_number, 0.02), one(wave_number, 0.02))
    assert instrument.transfer(1e3, 0.0, angle=0.5 * np.pi) == pytest.approx(np.exp(-((1e3 * 5e-6) ** 2) / 8.0))
    assert instrument.divergence == pytest.approx(632.8e-9 / (np.pi * 5e-6))


def test_a_drifting_wave_is_a_sine_in_time():
    """A frozen wave drifts by a quarter, half, ... : by offsets of the focus and by a series of fields alike."""
    instrument = FLDI(120e-6, 20e-6, direction=(0.0, 1.0, 0.0))
    turn = 2.0 * np.pi * np.arange(8) / 8
    offsets = np.stack([np.zeros(8), turn / 5e3, np.zeros(8)], axis=1)
    scanned = fldi_response(sheet(5e3, 0.0, instrument, room=2e-3), instrument, offsets=offsets)
    series = fldi_response([sheet(5e3, 0.0, instrument, angle) for angle in turn], instrument, time=1e-6 * np.arange(8))
    largest = float(np.abs(scanned.phase).max())
    assert scanned.phase == pytest.approx(largest * np.cos(turn), abs=1e-3 * largest)
    assert series.phase == pytest.approx(scanned.phase, abs=1e-3 * largest)
    frequency, power = series.spectrum()
    assert frequency[np.argmax(power)] == pytest.approx(125e3)
    assert series.to_xarray().phase.dims == ("time",) and "8 phases" in repr(series)
    assert series.signal()[2] == pytest.approx(0.5, abs=1e-3)


def test_a_body_holds_back_the_light():
    """A square rod of 1 mm in a blob: beside it as without it; half of both beams; one beam of the two; both."""
    from aerokernels.medium import Body

    y = z = np.linspace(-3e-3, 3e-3, 61)
    blob = 1e-4 * np.exp(-(y[:, None] ** 2 + z**2) / (2.0 * (8e-4) ** 2))
    rod = Body([[-5e-4, -5e-4], [5e-4, -5e-4], [5e-4, 5e-4], [-5e-4, 5e-4]], "planar")
    bare, blocked = (
        IndexField.from_samples(blob, origin=(y[0], z[0]), spacing=(1e-4, 1e-4), geometry="planar", body=body)
        for body in (None, rod)
    )
    instrument = FLDI(200e-6, 50e-6, direction=(0.0, 1.0, 0.0))
    offsets = np.array([[0.0, 1e-3, 0.0], [0.0, 6e-4, 0.0], [0.0, 5e-4, 0.0], [0.0, 0.0, 0.0]])
    free, held = (fldi_response(field, instrument, offsets=offsets, rays=41) for field in (bare, blocked))
    assert held.phase[0] == free.phase[0] and held.visibility[0] == free.visibility[0]
    # The second beam is cut in half, then all of it is (of a Gaussian 1e-4 passes): light without a twin is left.
    assert held.visibility[1] == pytest.approx(2.0 / 3.0, abs=0.06)
    assert held.visibility[2] < 1e-3
    assert np.isnan(held.phase[3]) and held.visibility[3] == 0.0 and np.isfinite(free.phase).all()
    assert "4 phases" in repr(held)


def test_a_strong_gradient_turns_the_phase_by_many_fringes():
    """An index that grows along y by g over the length L: the phase is k g L s, the visibility 1."""
    y, z = np.linspace(-2e-3, 2e-3, 9), np.linspace(-0.01, 0.01, 9)
    field = IndexField.from_samples(
        np.repeat(0.5 * y[:, None], 9, axis=1),
        origin=(y[0], z[0]),
        spacing=(y[1] - y[0], z[1] - z[0]),
        geometry="planar",
    )
    instrument = FLDI(120e-6, 20e-6, direction=(0.0, 1.0, 0.0))
    found = fldi_response(field, instrument)
    assert float(found.phase) == pytest.approx(2.0 * np.pi / instrument.wavelength * 0.5 * 0.02 * 120e-6, rel=1e-6)
    assert float(found.visibility) == pytest.approx(1.0, abs=1e-9)
    backward = FLDI(120e-6, 20e-6, direction=(0.0, -1.0, 0.0))
    assert float(fldi_response(field, backward).phase) == pytest.approx(-float(found.phase))


@pytest.mark.parametrize("slant", [0.0, 0.3, -0.9])
def test_a_slanted_way_through_a_slab_that_ends_abruptly(slant: float):
    """Index g y in a slab of the thickness L: k g s L / cos^2 of the slant, and the reported error holds.

    A layer of the beams that the slab's face cuts through counts by its part inside: without, 1 % is missing.
    """
    y, z = np.linspace(-0.03, 0.03, 61), np.linspace(-0.004, 0.004, 9)
    contrast = np.repeat(1e-2 * y[:, None], 9, axis=1)
    field = IndexField.from_samples(contrast, origin=(y[0], z[0]), spacing=(1e-3, 1e-3), geometry="planar")
    axis, direction = (0.0, np.sin(slant), np.cos(slant)), (0.0, np.cos(slant), -np.sin(slant))
    for focus in (0.0, 0.0131):
        instrument = FLDI(2e-4, 5e-5, focus=np.multiply(focus, axis), axis=axis, direction=direction, divergence=0.0)
        found = fldi_response(field, instrument)
        expected = 2.0 * np.pi / instrument.wavelength * 1e-2 * 2e-4 * 0.008 / np.cos(slant) ** 2
        assert float(found.phase) == pytest.approx(expected, rel=1e-5)
        assert abs(float(found.phase) - expected) < float(found.error) + 1e-9 * expected


@pytest.mark.parametrize("interpolation", first_of(["linear", "cubic", "monotone"]))
def test_the_error_told_holds_the_layers_along_the_beams(interpolation: str):
    """Waves aslant of nine samples each, which end at the faces, against sums of many more layers."""
    import aerokernels.fldi.instrument as rays

    y, z = np.linspace(-4e-3, 4e-3, 41), np.linspace(-0.02, 0.02, 31)
    contrast = 1e-5 * np.sin(3.5e3 * y[:, None] + 500.0 * z + 0.4)
    field = IndexField.from_samples(
        contrast,
        origin=(y[0], z[0]),
        spacing=(y[1] - y[0], z[1] - z[0]),
        geometry="planar",
        interpolation=interpolation,
    )
    for place, axis in (((0.0, 1e-3, 5e-3), (0.0, 0.03, 1.0)), ((0.0, -2e-4, -0.03), (0.0, 0.1, 1.0))):
        instrument = FLDI(2e-4, 2e-5, focus=place, axis=axis, direction=(0.0, 1.0, 0.0))
        found = fldi_response(field, instrument, rays=21)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rays, "LAYERS_PER_CELL", (40, 40))
            fine = fldi_response(field, instrument, rays=21)
        assert abs(float(found.phase) - float(fine.phase)) < float(found.error), (place, axis)


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_a_focus_on_a_face_of_the_field(end: float):
    """A field that begins or ends at the focus: k g s and the layer's integral; the box is the whole flow."""
    y, z = np.linspace(-3e-3, 3e-3, 31), np.linspace(-end * 0.02, 0.02 - end * 0.02, 41)
    for fading in (True, False):
        bell = np.sin(np.pi * (z - z[0]) / 0.02) ** 4 if fading else np.ones(41)
        field = IndexField.from_samples(
            1e-2 * y[:, None] * bell, origin=(y[0], z[0]), spacing=(2e-4, 5e-4), geometry="planar"
        )
        instrument = FLDI(2e-4, 5e-5, direction=(0.0, 1.0, 0.0), divergence=0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("error", TruncationWarning)
            found = fldi_response(field, instrument)
        path = 2.0 * np.pi / instrument.wavelength * 1e-2 * 2e-4 * 0.02 * (0.375 if fading else 1.0)
        assert float(found.phase) == pytest.approx(path, rel=1e-4)
        assert float(found.truncated) == 0.0


def test_what_is_refused():
    instrument = FLDI(120e-6, 20e-6)
    field = sheet(5e3, 0.0, instrument)
    with pytest.raises(ValueError, match="separation"):
        FLDI(0.0, 1e-5)
    with pytest.raises(ValueError, match="along the axis"):
        FLDI(1e-4, 1e-5, direction=(0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="do not meet"):
        fldi_response(field, FLDI(1e-4, 1e-5, focus=(0.0, 1.0, 0.0)))
    with pytest.raises(TypeError, match="FLDI"):
        fldi_response(field, "instrument")
    with pytest.raises(ValueError, match="time is only for several fields"):
        fldi_response(field, instrument, time=[0.0])
    with pytest.raises(ValueError, match="finite and increase"):
        fldi_response([field, field], instrument, time=[0.0, np.nan])
    with pytest.raises(ValueError, match="offsets"):
        fldi_response(field, instrument, offsets=[1.0])
    with pytest.raises(TypeError, match="a Series or several fields, got int"):
        fldi_response(3, instrument)
    with pytest.raises(ValueError, match="infinite along x"):
        fldi_response(field, FLDI(1e-4, 1e-5, axis=(1.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match=r"shapes that broadcast, got \(2,\) and \(3,\)"):
        instrument.transfer([1.0, 2.0], [0.0, 1.0, 2.0])


def test_beams_wider_than_a_region_are_told():
    """Air that grows along y, cut 0.25 mm beside the axis, in a sheet where a beam's radius is 0.5 mm.

    Of a Gaussian beam, 1 - erf(sqrt(2) 0.25 / 0.5) = 0.317 lies beyond; of one of 0.05 mm, 1e-23; beams that pass the
    region beside its cut are marked as well. Of the whole flow nothing is cut off.
    """
    y, z = np.linspace(-1.5e-3, 1.5e-3, 301), np.linspace(-0.75, 0.75, 25) * THICKNESS
    contrast = 1e4 * STRENGTH * (1.0 + 400.0 * y)[:, None] * bell(z)
    parts = {"origin": (y[0], z[0]), "spacing": (y[1] - y[0], z[1] - z[0]), "geometry": "planar"}
    whole = IndexField.from_samples(contrast, **parts)
    field = whole.resample(parts["spacing"], region=((-2.5e-4, z[0]), (2.5e-4, z[-1])))
    wide, narrow = (FLDI(1e-6, waist, direction=(0.0, 1.0, 0.0), divergence=0.0) for waist in (5e-4, 5e-5))
    with pytest.warns(TruncationWarning, match=r"2\d\.?\d* % of the light goes through disturbed air that was"):
        found = fldi_response(field, wide)
    assert float(found.truncated) == pytest.approx(0.317, abs=0.08) and "air that was cut off" in repr(found)
    assert float(fldi_response(field, narrow).truncated) == 0.0
    with pytest.warns(TruncationWarning, match="of the light"):
        fldi_response(field, narrow, offsets=[[0.0, 0.0, 0.0], [0.0, 5.5e-4, 0.0]])
    assert float(fldi_response(whole, wide).truncated) == 0.0


@pytest.mark.parametrize("seed", first_of([1, 5, 3, 10]))
def test_the_error_told_holds_the_fields_own_nodes(seed: int):
    """Waves, bells and layers of closed form on grids of few nodes; the reported error covered none of them before."""
    found = check_reading(draw_reading(seed))
    assert found.covered, found


@pytest.mark.slow
def test_the_error_told_holds_a_resampling_and_how_a_field_was_made():
    """A mesh resampled too coarsely, against the mesh; and the refractivity's share of the phase."""
    from dataclasses import replace

    from aerokernels import QuadMesh
    from aerokernels.medium.field import Upstream

    y, z = np.meshgrid(np.linspace(-4e-3, 4e-3, 161), np.linspace(-4e-3, 4e-3, 161), indexing="ij")
    mesh = IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), 1e-6 * np.exp(-(y**2 + z**2) / (2.0 * 6e-4**2)))
    coarse = mesh.resample(5e-4)
    instrument = FLDI(2e-4, 2e-5, focus=(0.0, 4e-4, 0.0), direction=(0.0, 1.0, 0.0))
    exact, found = fldi_response(mesh, instrument), fldi_response(coarse, instrument)
    assert abs(float(found.phase) - float(exact.phase)) < float(found.error) < 0.3 * abs(float(exact.phase))
    assert float(found.error) > 3.0 * float(exact.error)
    unsure = fldi_response(replace(mesh, upstream=Upstream(0.0, 0.1)), instrument)
    assert 0.1 * abs(float(exact.phase)) < float(unsure.error) < abs(float(exact.phase))
    lost = replace(coarse, resampling=replace(coarse.resampling, source=None))
    assert np.isnan(fldi_response(lost, instrument).error)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_half_of_the_light_is_truncated_where_one_beam_goes_through_cuts(side: float):
    """Air that is disturbed on one side, beyond both ends of the region: all light of one beam, none of the other's."""
    y, z = np.linspace(-6e-3, 6e-3, 61), np.linspace(-1e-2, 1e-2, 41)
    contrast = 1e-5 * np.clip((side * y - 0.5e-3) / 1e-3, 0.0, 1.0)[:, None] * np.ones(41)
    whole = IndexField.from_samples(contrast, origin=(y[0], z[0]), spacing=(2e-4, 5e-4), geometry="planar")
    field = whole.resample((2e-4, 5e-4), region=((-6e-3, -5e-3), (6e-3, 5e-3)))
    with pytest.warns(TruncationWarning):
        found = fldi_response(field, FLDI(4e-3, 5e-5, direction=(0.0, 1.0, 0.0)))
    assert float(found.truncated) == pytest.approx(0.5, abs=1e-6)
