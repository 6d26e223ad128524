"""One check of wavelengths for every entry, and a field that is evaluated at the wavelength it was made for."""

import pickle

import numpy as np
import pytest

from aerokernels import (
    Disc,
    IndexField,
    RayBundle,
    Scene,
    estimate_strehl,
    flow,
    interferogram,
    point_spread_function,
    schlieren,
    shadowgraph,
    strehl,
    strehl_marechal,
    trace,
)
from aerokernels.benches import line_of_sight
from aerokernels.focus.estimate import PreparedStrehl
from aerokernels.inputs.checks import check_wavelength

GREEN = 532e-9


def raw_field() -> IndexField:
    """A weak lens of raw contrast on 17 x 17 nodes over 16 mm."""
    y, z = np.meshgrid(np.linspace(-8e-3, 8e-3, 17), np.linspace(0.0, 16e-3, 17), indexing="ij")
    contrast = 2e-5 * np.exp(-(y**2 + (z - 8e-3) ** 2) / 2e-3**2)
    return IndexField.from_samples(contrast, origin=(-8e-3, 0.0), spacing=(1e-3, 1e-3), geometry="planar")


def cone_flow():
    return flow.cone(2.0, np.radians(15.0), length=0.02)


PUPIL = Disc(2e-3, center=(0.0, 0.0, -1e-3))
RAYS = RayBundle([[0.0, 1e-3, -1e-3]], [[0.0, 0.0, 1.0]])
PICTURE = {"pixel_count": 8, "width": 1e-2}

# Every entry that takes a field and a wavelength; what each gives depends on the wavelength by a number.
FIELD_ENTRIES = {
    "trace": lambda field, **w: trace(field, RAYS, **w).wavelength,
    "estimate_strehl": lambda field, **w: estimate_strehl(field, PUPIL, ray_count=256, **w).value,
    "prepared": lambda field, **w: PreparedStrehl(field, PUPIL, ray_count=256, **w).job.predicted_ray_count,
    "line_of_sight": lambda field, **w: line_of_sight(field, **PICTURE, **w).wavelength,
    "schlieren": lambda field, **w: schlieren(field, **PICTURE, **w).intensity.sum(),
    "shadowgraph": lambda field, **w: shadowgraph(field, distance=0.5, **PICTURE, **w).intensity.sum(),
    "interferogram": lambda field, **w: interferogram(field, **PICTURE, **w).wavelength,
    "resample": lambda field, **w: field.resample(tolerance=1.0, **w).samples.samples.size,
}
OPD = np.linspace(0.0, 1e-7, 16).reshape(4, 4)
# Every entry that takes a wavelength and no field.
OTHER_ENTRIES = {
    "strehl": lambda w: strehl(OPD, w),
    "strehl_marechal": lambda w: strehl_marechal(OPD, w),
    "point_spread_function": lambda w: point_spread_function(OPD, np.ones((4, 4)), 1e-3, w),
    "gladstone_dale_constant": lambda w: flow.gladstone_dale_constant(w),
    "index_field": lambda w: flow.uniform_air().index_field(w),
    "index_field, own constant": lambda w: flow.uniform_air().index_field(w, constant=2.24e-4),
    "cone": lambda w: cone_flow().index_field(w),
    "cone, own constant": lambda w: cone_flow().index_field(w, constant=2.24e-4),
    "from_samples": lambda w: IndexField.from_samples(
        np.zeros((5, 5)), origin=(0, 0), spacing=(1, 1), geometry="planar", wavelength=w
    ),
}


@pytest.mark.parametrize("entry", [*FIELD_ENTRIES, *OTHER_ENTRIES])
def test_no_entry_takes_a_wavelength_in_the_wrong_unit(entry):
    call = OTHER_ENTRIES.get(entry) or (lambda wavelength: FIELD_ENTRIES[entry](raw_field(), wavelength=wavelength))
    with pytest.raises(ValueError, match=r"wavelength .* m is outside 0\.1 to 24 um: give metres, .* for .* .m"):
        call(0.905)
    with pytest.raises(ValueError, match=r"wavelength must be a positive length in metres, got"):
        call(-905e-9)


@pytest.mark.parametrize("wavelength", ["905 nm", True, (905e-9, 532e-9), 1j])
def test_what_is_no_number_is_refused_by_name(wavelength):
    with pytest.raises(TypeError, match=r"wavelength must be a number of metres, got .* give 905e-9 for 905 nm"):
        check_wavelength(wavelength)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (905.0, "905 m is outside 0.1 to 24 um: give metres, 9.05e-07 for 905 nm"),
        (0.905, "give metres, 9.05e-07 for 0.905 um"),
        (1.55, "give metres, 1.55e-06 for 1.55 um"),
        (9.05e-4, "give metres, 9.05e-07 for 0.000905 mm"),
        (1e-300, "give metres, 905e-9 for 905 nm"),
    ],
)
def test_the_message_says_what_was_perhaps_meant(given, meant):
    with pytest.raises(ValueError, match=meant.replace(".", r"\.")):
        check_wavelength(given)


def test_the_ends_of_the_range_are_wavelengths():
    assert check_wavelength(0.1e-6) == 0.1e-6 and check_wavelength(20e-6) == 20e-6
    assert check_wavelength(np.float32(1e-6)) == float(np.float32(1e-6))


@pytest.mark.parametrize(
    "make",
    [
        lambda: flow.uniform_air().index_field(GREEN),
        lambda: flow.uniform_air().index_field(GREEN, constant=2.24e-4),
        lambda: cone_flow().index_field(GREEN),
        lambda: flow.shipped("mach3").scaled(0.5).index_field(GREEN),
    ],
)
def test_a_flows_index_field_keeps_its_wavelength(make):
    """And what is made of it does: resampled, coarser, under another interpolant, pickled."""
    field = make()
    assert field.wavelength == GREEN
    assert pickle.loads(pickle.dumps(field)).wavelength == GREEN
    assert field.with_interpolation(field.interpolation).wavelength == GREEN
    grid = field.resample(0.1 * float(field.samples.high[0]))
    assert grid.wavelength == GREEN


@pytest.mark.parametrize("entry", FIELD_ENTRIES)
def test_no_entry_evaluates_a_field_at_another_wavelength(entry):
    """Both wavelengths and the remedy are in the message; the field's own, also written otherwise, is taken."""
    raw = raw_field()
    field = IndexField(raw.samples, raw.geometry, raw.ambient_index, wavelength=GREEN)
    call = FIELD_ENTRIES[entry]
    with pytest.raises(
        ValueError, match=r"9\.05e-07 m was requested, .* made for 5\.32e-07 m: make the index field at"
    ):
        call(field, wavelength=905e-9)
    assert call(field) == call(field, wavelength=GREEN) == call(field, wavelength=0.532 * 1e-6)


def test_the_strehl_ratio_is_that_of_the_fields_own_wavelength():
    """Set-up: a field made for 532 nm. Formula: |<exp(i k OPD)>|^2 of traced rays with k = 2 pi / 532 nm.

    Expected: what `strehl` gives for the same OPD, to the sampling of 4096 rays (1e-3); at 905 nm it differs by more.
    """
    field = cone_flow().index_field(GREEN, spacing=4e-4)
    pupil = Disc(1e-3, center=(0.0, 4e-3, -8e-3))
    found = estimate_strehl(field, pupil, ray_count=4096)
    opd = trace(field, RayBundle.collimated(pupil, 4096), outputs="opd").opd
    assert found.value == pytest.approx(strehl(opd, GREEN), abs=1e-3)
    assert abs(strehl(opd, GREEN) - strehl(opd, 905e-9)) > 1e-2


@pytest.mark.parametrize("text", ["905", "905 um", '"0.05 um"', "0.905"])
def test_a_scene_names_its_key(text):
    with pytest.raises(ValueError, match=r"flow\.wavelength = .*outside 0\.1 to 24 um: give metres"):
        Scene.load("wind-tunnel-static", {"flow.wavelength": text})
