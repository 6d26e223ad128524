"""Slabs and layers of waves: what is moved with its window, or turned with it, gives the same numbers."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Wave, wavefront
from aerokernels.medium import Body
from aerokernels.waves.layers import layer_count, span_of
from aerokernels.waves.shadows import SlabsPastBody
from aerokernels.waves.slabs import FINEST, LEFT_OUT, LookingAlong, SlabsAlongZ, SlabsOfLayers, is_summed
from tests.moved_air import PITCH, lumps
from tests.phase_plates import WAVELENGTH

AXES = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
UP = np.array([0.0, 0.0, 1.0])


def slabs(kind: type, field: IndexField, center: np.ndarray):
    window = LookingAlong(center, UP, AXES, 3.0 * PITCH)
    begin, end = (float(end - center[2]) for end in (field.box[0][2], field.box[1][2]))
    given = (field, window, begin, end)
    return kind(*given) if kind is SlabsOfLayers else kind(*given, WAVELENGTH)


KINDS = [SlabsAlongZ, SlabsOfLayers, SlabsPastBody]


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("kind", KINDS)
def test_air_and_window_that_are_moved_together_give_the_same_slabs(kind: type, interpolation: str):
    """By whole cells, aside, up and along; single precision of layers, 1e-6 of the greatest path."""
    x, y = PITCH * np.linspace(-3.0, 2.0, 6), PITCH * np.linspace(-2.0, 3.0, 6)
    found = []
    for move in (np.zeros(3), PITCH * np.array([6.0, -3.0, 2.0])):
        field = lumps(move, interpolation=interpolation)
        one = slabs(kind, field, move + np.array([PITCH, -2.0 * PITCH, field.box[0][2] - move[2]]))
        found.append((one.paths(x, y, 8), one.paths(x, y, FINEST)))
    for here, there in zip(*found, strict=True):
        assert np.ptp(here) > 0.0
        np.testing.assert_allclose(there, here, atol=1e-6 * np.abs(here).max())


@pytest.mark.parametrize("kind", KINDS)
def test_x_and_y_may_be_exchanged(kind: type):
    """Air and window: paths of pixels in rows are those of pixels in columns."""
    x, y = PITCH * np.linspace(-3.0, 2.0, 6), PITCH * np.linspace(-2.0, 3.0, 6)
    center = np.array([2.0 * PITCH, -PITCH, lumps().box[0][2]])
    plain, turned = slabs(kind, lumps(), center), slabs(kind, lumps(turned=True), center[[1, 0, 2]])
    for count in (8, FINEST):
        here, there = plain.paths(x, y, count), turned.paths(y, x, count)
        np.testing.assert_allclose(there, here.swapaxes(1, 2), atol=1e-6 * np.abs(here).max())


def test_both_kinds_of_slabs_hold_the_same_path():
    """Sums over coefficients and sampled layers, over all the way, to what sums leave out at each end.

    Less the first pixel's: what all the light has in common is not held.
    """
    x, y = PITCH * np.linspace(-3.0, 2.0, 6), PITCH * np.linspace(-2.0, 3.0, 6)
    center = np.array([2.0 * PITCH, -PITCH, lumps().box[0][2]])
    whole = [slabs(kind, lumps(), center).paths(x, y, 8).sum(axis=0) for kind in KINDS]
    whole = [each - each[0, 0] for each in whole]
    for other in whole[1:]:
        np.testing.assert_allclose(other, whole[0], atol=2.0 * LEFT_OUT * WAVELENGTH / (2.0 * np.pi))


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("look", [1.0, -1.0])
def test_a_box_lies_where_its_faces_are(geometry: str, look: float):
    """Lines along z: from the wave to the faces, at least 0; whether they meet the box, by its sides."""
    half = 8.0 * PITCH
    shape = {"volume": (17, 17, 25), "planar": (17, 25), "axisymmetric": (9, 25)}[geometry]
    low = {"volume": (-half, -half), "planar": (-half,), "axisymmetric": (0.0,)}[geometry]
    field = IndexField.from_samples(
        np.full(shape, 1e-6), origin=(*low, PITCH), spacing=(PITCH,) * len(shape), geometry=geometry
    )
    normal, ends = look * UP, (-PITCH, PITCH)
    behind = np.array([0.0, 0.0, -5.0 * PITCH if look > 0.0 else 30.0 * PITCH])
    assert span_of(field, behind, normal, AXES, ends, ends) == pytest.approx(
        (6 * PITCH if look > 0 else 5 * PITCH, 30 * PITCH if look > 0 else 29 * PITCH)
    )
    within = np.array([0.0, 0.0, 10.0 * PITCH])
    left = (15.0 if look > 0.0 else 9.0) * PITCH
    assert span_of(field, within, normal, AXES, ends, ends) == pytest.approx((0.0, left), abs=1e-12)
    for aside in ([0.0, 1.5 * half, 0.0], [0.0, -1.5 * half, 0.0], [1.5 * half, 0.0, 0.0]):
        if geometry == "planar" and aside[0]:  # which has no end in x
            assert span_of(field, behind + aside, normal, AXES, ends, ends)[1] > 0.0
            continue
        with pytest.raises(ValueError, match="does not meet the field"):
            span_of(field, behind + aside, normal, AXES, ends, ends)
        # A window wide enough to reach the box from there meets it.
        assert span_of(field, behind + aside, normal, AXES, (-half, half), (-half, half)) == pytest.approx(
            span_of(field, behind, normal, AXES, ends, ends), rel=1e-6
        )
    with pytest.raises(ValueError, match="does not meet the field"):  # looking away from it
        span_of(field, behind, -normal, AXES, ends, ends)


def test_a_slanted_line_of_sight_is_no_sum():
    field = lumps()
    assert is_summed(field, UP) and is_summed(field, -UP)
    slanted = np.array([0.0, np.sin(1e-3), np.cos(1e-3)])
    assert not is_summed(field, slanted)


def test_layers_of_a_path_are_as_many_as_its_cells():
    """A power of two that holds all cells, or a multiple of the steps asked for."""
    field = lumps()
    assert layer_count(field, 64.0 * PITCH, None) == 64
    assert layer_count(field, 65.0 * PITCH, None) == 128
    assert layer_count(field, 64.0 * PITCH, 10) == 70
    assert layer_count(field, 64.0 * PITCH, 64) == 64
    assert layer_count(field, 64.0 * PITCH, 100) == 100
    assert layer_count(field, 1e3 * PITCH, None, 256) == 256


def test_a_body_that_is_moved_with_the_window_casts_the_same_shadow():
    """A wall beside the axis of a planar flow: opaque to one side of its edge, at every place of the window."""
    x = PITCH * np.linspace(-2.0, 2.0, 5)
    seen = []
    for move in (0.0, 4.0 * PITCH):
        low = -10.0 * PITCH + move
        wall = np.array([[low, 4.0], [2.5 * PITCH + move, 4.0], [2.5 * PITCH + move, 12.0], [low, 12.0]])
        wall[:, 1] *= PITCH
        field = IndexField.from_samples(
            np.full((21, 25), 1e-6), origin=(low, 0.0), spacing=(PITCH, PITCH), geometry="planar",
            body=Body(wall, "planar"),
        )  # fmt: skip
        window = LookingAlong(np.array([0.0, move + PITCH, -PITCH]), UP, AXES, 4.0 * PITCH)
        past = SlabsPastBody(field, window, PITCH, 25.0 * PITCH, WAVELENGTH)
        y = PITCH * np.linspace(-4.0, 4.0, 9)
        opaque = past.opaque(x, y, 8)
        dark = opaque.any(axis=0)
        assert dark.all(axis=1).tolist() == (y + PITCH < 2.5 * PITCH).tolist()
        assert not dark[-1].any() and opaque[1:4].any() and not opaque[5:].any()
        seen.append((opaque, past.paths(x, y, 8)))
    np.testing.assert_array_equal(seen[0][0], seen[1][0])
    np.testing.assert_allclose(seen[0][1], seen[1][1], atol=1e-6 * np.abs(seen[0][1]).max())


def test_a_pupil_that_is_moved_with_the_air_has_the_same_wavefront():
    """Off the axis in both directions, so that no symmetry hides a sign: OPD to 1e-12 m."""
    maps = []
    for move in (np.zeros(3), PITCH * np.array([5.0, -7.0, 3.0])):
        pupil = Disc(3.0 * PITCH, np.array([PITCH, 2.0 * PITCH, -16.0 * PITCH]) + move)
        found = wavefront(lumps(move), pupil, wavelength=WAVELENGTH, pixel_count=16, precision="float64")
        maps.append((np.nan_to_num(found.opd), found.weight))
    np.testing.assert_allclose(maps[1][0], maps[0][0], atol=1e-12)
    np.testing.assert_allclose(maps[1][1], maps[0][1], atol=1e-12)
    assert np.ptp(maps[0][0]) > 1e-10


def test_a_wave_that_is_moved_with_the_air_is_the_same_wave():
    from aerokernels import split_step

    found = []
    for move in (np.zeros(3), PITCH * np.array([4.0, -2.0, 8.0])):
        light = Wave(np.ones((32, 32)), PITCH / 4.0, WAVELENGTH, np.array([PITCH, 0.0, -16.0 * PITCH]) + move, UP)
        found.append(split_step(lumps(move), light, step_count=16).amplitude)
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)
    assert np.abs(np.angle(found[0])).max() > 1e-3
