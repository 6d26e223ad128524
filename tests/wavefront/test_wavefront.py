"""Wavefronts: piston and tilt, and the point spread function against Airy's pattern."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import point_spread_function
from aerokernels.focus import strehl
from aerokernels.rays import unit_disc_samples
from aerokernels.wavefronts import check_terms, fit_tilt, remove_terms

WAVELENGTH = 905e-9
small = st.floats(-1e-5, 1e-5)


# --- piston and tilt -------------------------------------------------------------------------------------------------


@given(piston=small, tilt=st.tuples(small, small), shift=st.floats(-1.0, 1.0), seed=st.integers(0, 100))
@settings(max_examples=50, deadline=None)
def test_a_plane_is_fitted_exactly(piston, tilt, shift, seed):
    """Any weights, points off the origin by up to 1 m; the piston is the weighted mean. Rounding: 1e-18 m of 1e-5."""
    rng = np.random.default_rng(seed)
    points, weights = rng.uniform(-0.006, 0.006, (40, 2)) + shift, rng.uniform(0.1, 1.0, 40)
    opd = piston + points @ tilt
    fit = fit_tilt(opd, points, weights)
    assert np.abs(fit.tilt - tilt).max() < 1e-12 + 1e-9 * np.abs(tilt).max()
    assert abs(fit.piston - weights @ opd / weights.sum()) < 1e-18
    assert fit.residual_rms < 1e-14
    assert np.abs(remove_terms(opd, ("piston", "tilt"), points, weights)).max() < 1e-14


def test_what_is_left_of_defocus():
    """OPD = d r^2 on a disc: no tilt, residual rms d / sqrt(12) (r^2 is uniform on [0, 1]); Gauss points are exact."""
    points, weights = unit_disc_samples(400, "gauss")
    fit = fit_tilt(1e-7 * np.sum(points**2, axis=1), points, weights)
    assert np.abs(fit.tilt).max() < 1e-20
    assert fit.piston == pytest.approx(0.5e-7, rel=1e-12)
    assert fit.residual_rms == pytest.approx(1e-7 / np.sqrt(12.0), rel=1e-12)


def test_a_pupil_that_is_a_line_has_no_slope_across_it():
    points = np.stack([np.linspace(-1.0, 1.0, 9), np.full(9, 3.0)], axis=1)
    assert fit_tilt(2.0 * points[:, 0] + 1.0, points).tilt == pytest.approx([2.0, 0.0], abs=1e-14)
    assert fit_tilt([5.0], [[1.0, 1.0]]).tilt == pytest.approx([0.0, 0.0])


def test_terms_are_removed_as_named():
    points, weights = unit_disc_samples(100, "gauss")
    flat = np.sum(points**2, axis=1)
    opd = flat + 3.0 + points @ [1.0, -2.0]
    assert np.array_equal(remove_terms(opd, (), points, weights), opd)
    assert remove_terms(opd, "piston", None, weights) == pytest.approx(opd - weights @ opd)
    assert remove_terms(opd, "tilt", points, weights) == pytest.approx(flat + 3.0, abs=1e-13)
    assert remove_terms(opd, ["tilt", "piston"], points, weights) == pytest.approx(flat - 0.5, abs=1e-13)
    assert check_terms("tilt") == ("tilt",)
    # Focus alone is about the origin, and with tilt about wherever the points are: both leave nothing of a paraboloid.
    off = points + np.array([2.0, -1.0])
    bowl = 5.0 * np.sum(off**2, axis=1) + 3.0
    for terms in (("piston", "focus"), ("piston", "tilt", "focus")):
        assert np.abs(remove_terms(bowl, terms, off, weights)).max() < 1e-12 * bowl.max()
    leaning = np.sum((off - [2.0, 0.0]) ** 2, axis=1)
    assert np.abs(remove_terms(leaning, ("piston", "tilt", "focus"), off, weights)).max() < 1e-12
    assert np.abs(remove_terms(leaning, ("piston", "focus"), off, weights)).max() > 0.1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: check_terms(("piston", "coma")), r"cannot remove \['coma'\]: choose from piston, tilt"),
        (lambda: remove_terms(np.zeros(3), "tilt"), "removing 'tilt' needs"),
        (lambda: fit_tilt(np.zeros(3), np.zeros((4, 2))), r"shape \(3, 2\) like the wavefront, got \(4, 2\)"),
        (lambda: fit_tilt(np.zeros(3), np.full((3, 2), np.nan)), "points must be finite"),
        (lambda: fit_tilt([0.0, np.nan, np.inf], np.zeros((3, 2))), "got 2 bad of 3 samples"),
        (lambda: fit_tilt([], np.zeros((0, 2))), "not empty"),
        (lambda: fit_tilt(np.zeros(3), np.zeros((3, 2)), np.zeros(3)), "not all zero"),
        (lambda: fit_tilt(np.zeros(3), np.zeros((3, 2)), [1.0, -1.0, 1.0]), "not negative"),
        (lambda: fit_tilt(np.zeros(3), np.zeros((3, 2)), [1.0, 1.0]), "one for each of the 3 samples; got 2"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# --- point spread function -------------------------------------------------------------------------------------------

SIDE, RADIUS = 96, 6e-3
PIXEL = 2.0 * RADIUS / SIDE


def pupil() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates of the pixels' centres and the disc's share of each pixel, by 16 x 16 points in it."""
    fine = (np.arange(SIDE * 16) + 0.5) / (SIDE * 16) * 2.0 - 1.0
    share = (fine[:, None] ** 2 + fine[None, :] ** 2 <= 1.0).reshape(SIDE, 16, SIDE, 16).mean(axis=(1, 3))
    axis = (np.arange(SIDE) + 0.5) * PIXEL - RADIUS
    return *np.meshgrid(axis, axis, indexing="ij"), share


@given(seed=st.integers(0, 1000), strength=st.floats(0.0, 3e-7), padding=st.integers(1, 4))
@settings(max_examples=15, deadline=None)
def test_energy_and_the_strehl_ratio(seed, strength, padding):
    """Whatever the wavefront, the sum of the intensity is Parseval's, and its value on the axis is the Strehl ratio."""
    rng = np.random.default_rng(seed)
    opd, mask = strength * rng.standard_normal((24, 24)), rng.uniform(0.0, 1.0, (24, 24)) * (rng.random((24, 24)) > 0.2)
    spread = point_spread_function(opd, mask, 1e-4, WAVELENGTH, padding=padding)
    size = 24 * padding
    assert spread.intensity.sum() == pytest.approx(size**2 * np.sum(mask**2) / mask.sum() ** 2, rel=1e-12)
    assert spread.angle[size // 2] == 0.0
    assert spread.intensity[size // 2, size // 2] == pytest.approx(strehl(opd, WAVELENGTH, mask), abs=1e-12)


@pytest.mark.parametrize("steps", [(-12, 7), (30, -30)])
def test_tilt_moves_the_peak_by_its_angle(steps):
    """A tilt of whole samples of the angle moves the undistorted pattern there and changes nothing else."""
    x, y, share = pupil()
    sample = WAVELENGTH / (8 * SIDE * PIXEL)
    tilt = np.array(steps) * sample
    flat = point_spread_function(np.zeros_like(x), share, PIXEL, WAVELENGTH)
    leaned = point_spread_function(tilt[0] * x + tilt[1] * y, share, PIXEL, WAVELENGTH)
    row, column = np.unravel_index(np.argmax(leaned.intensity), leaned.intensity.shape)
    assert (leaned.angle[row], leaned.angle[column]) == pytest.approx(tuple(tilt), abs=1e-3 * sample)
    assert np.abs(np.roll(flat.intensity, steps, axis=(0, 1)) - leaned.intensity).max() < 1e-12


def test_what_lies_outside_the_pupil_does_not_matter():
    _, _, share = pupil()
    opd = np.zeros((SIDE, SIDE))
    opd[share == 0.0] = np.nan
    spread = point_spread_function(opd, share, PIXEL, WAVELENGTH, padding=2)
    assert np.isfinite(spread.intensity).all() and spread.intensity.max() == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"opd": np.zeros((4, 5)), "mask": np.ones((4, 5))}, r"same shape, got \(4, 5\) and \(4, 5\)"),
        ({"mask": np.ones((5, 5))}, r"got \(4, 4\) and \(5, 5\)"),
        ({"opd": np.zeros(4), "mask": np.ones(4)}, "square and have the same shape"),
        ({"pixel": 0.0}, "must be positive, got 0.0"),
        ({"wavelength": -1.0}, "must be a positive length"),
        ({"padding": 0}, "must be positive"),
        ({"half_width": -1e-6}, "half_width must be an angle of at least 0 rad, or None, got -1e-06"),
        ({"mask": np.zeros((4, 4))}, "must not be empty"),
        ({"opd": np.full((4, 4), np.nan)}, "must be finite"),
    ],
)
def test_what_is_no_pupil(change, message):
    good = {"opd": np.zeros((4, 4)), "mask": np.ones((4, 4)), "pixel": 1e-4, "wavelength": WAVELENGTH}
    with pytest.raises(ValueError, match=message):
        point_spread_function(**{**good, **change})


@pytest.mark.parametrize("remove", [("piston",), ("focus",), ("tilt", "focus")])
@pytest.mark.parametrize("weighted", [False, True])
def test_terms_are_fitted_together_with_the_mean(remove: tuple[str, ...], weighted: bool):
    """Plain weighted least squares. What is removed has mean 0 unless piston is removed; focus is about the origin."""
    draw = np.random.default_rng(1)
    points, opd = draw.uniform(-1.0, 2.0, (40, 2)), 1e-6 * draw.normal(size=40)
    weight = draw.uniform(0.2, 1.0, 40) if weighted else np.ones(40)
    columns = [np.ones(40), *(points.T if "tilt" in remove else [])]
    columns += [(points**2).sum(axis=1)] if "focus" in remove else []
    basis, root = np.stack(columns, axis=1), np.sqrt(weight)
    left = opd - basis @ np.linalg.lstsq(basis * root[:, None], opd * root, rcond=None)[0]
    if "piston" not in remove:
        left = left + np.average(opd, weights=weight)
    found = remove_terms(opd, remove, points, weight if weighted else None)
    np.testing.assert_allclose(found, left, atol=1e-18)
