"""Two told errors contain the truth in 95 of 100 series of correlated snapshots, however few of them are independent.

Set-up: maps a_m(t) b_m(x) + s(x), of six known shapes b_m and a steady map s, with Gaussian amplitudes a_m of variance
1 whose correlation in time is known. Truths are closed forms in b, s and, for spectra, of an AR(1) series.
"""

import warnings

import numpy as np
import pytest
import xarray

from aerokernels import Disc, statistics
from aerokernels.series.pupil_grid import pupil_grid

from .fourier import WAVELENGTH

GRID, STEP, DRAWS = pupil_grid(Disc(0.02), 8), 1e-5, 12
PLACES, WEIGHT = GRID.coordinates, GRID.weight[GRID.lit] / GRID.weight.sum()
PHASE = PLACES @ np.array([[150.0, 40.0], [-60.0, 210.0], [330.0, -120.0]]).T
SHAPES = 3e-8 * np.concatenate([np.cos(PHASE), np.sin(PHASE)], axis=1).T * np.tile([1.0, 0.8, 0.6], 2)[:, None]
STEADY = 4e-8 * np.cos(PLACES @ [100.0, 100.0])


def autoregressive(draw: np.random.Generator, count: int, share: float) -> np.ndarray:
    values = draw.normal(size=(len(SHAPES), count))
    for k in range(1, count):
        values[:, k] = share * values[:, k - 1] + np.sqrt(1.0 - share**2) * values[:, k]
    return values


def smoothed(draw: np.random.Generator, count: int, width: float) -> np.ndarray:
    """Correlation exp(-(lag / 2 width)^2)."""
    kernel = np.exp(-0.5 * (np.arange(-int(5 * width), int(5 * width) + 1) / width) ** 2)
    kernel /= np.linalg.norm(kernel)
    noise = draw.normal(size=(len(SHAPES), count + len(kernel) - 1))
    return np.array([np.convolve(one, kernel, "valid") for one in noise])


def left_over(maps: np.ndarray, weight: np.ndarray, tilt: bool) -> float:
    """Mean square over the pupil of the sum of independent maps, mean, and tilt, removed."""
    used, root = weight > 0.0, np.sqrt(weight / weight.sum())
    basis = np.c_[np.ones(len(PLACES)), PLACES][:, : 3 if tilt else 1]
    ortho = np.linalg.qr((root[:, None] * basis)[used])[0]
    rest = (root * maps)[:, used].T
    return float(((rest - ortho @ (ortho.T @ rest)) ** 2).sum())


def truths() -> dict:
    both = np.vstack([SHAPES, STEADY])
    variance = np.sum(SHAPES**2, axis=0)
    root = np.sqrt(WEIGHT)[:, None]
    tilts = np.linalg.lstsq(root * np.c_[np.ones(len(PLACES)), PLACES], root * both.T)[0][1:]
    turn = 2.0 * np.pi / WAVELENGTH
    structure = np.sum((SHAPES[:, :, None] - SHAPES[:, None]) ** 2, axis=0)
    phasors = np.exp(-0.5 * turn**2 * structure) * np.cos(turn * (STEADY[:, None] - STEADY))
    half = np.minimum(Disc(0.01).coverage(*[np.linspace(-0.02, 0.02, 9)] * 2)[GRID.lit], WEIGHT / WEIGHT.max())
    return {
        "opd_rms": np.sqrt(left_over(both, WEIGHT, True)),
        "opd_rms_with_tilt": np.sqrt(left_over(both, WEIGHT, False)),
        "opd_rms_unsteady": np.sqrt(WEIGHT @ variance),
        "opd_rms_steady": np.sqrt(WEIGHT @ (STEADY - WEIGHT @ STEADY) ** 2),
        "opd_mean": GRID.spread(STEADY),
        "opd_std": GRID.spread(np.sqrt(variance)),
        "boresight_x": tilts[0, -1],
        "boresight_y": tilts[1, -1],
        "jitter_x": np.linalg.norm(tilts[0, :-1]),
        "jitter_y": np.linalg.norm(tilts[1, :-1]),
        "strehl": WEIGHT @ phasors @ WEIGHT,
        "opd_rms_aperture": np.sqrt([left_over(both, one, True) for one in (half, WEIGHT)]),
    }


@pytest.mark.parametrize(
    ("drawn", "correlation", "count", "few"),
    [(autoregressive, 0.955, 128, True), (autoregressive, 0.8, 256, False), (smoothed, 6.0, 160, True)],
)
def test_told_errors_contain_the_truth(drawn, correlation, count, few):
    """128 snapshots that hold 3 independent ones, 256 of 28, and 160 of 8 whose correlation ends abruptly.

    Of 12 draws each number may miss 3, the mean of 0.6 and three standard deviations; all numbers together, which
    depend on one another, 8 of 100. The variance is right on average within a fifth: three of its standard errors.
    """
    expected, draw = truths(), np.random.default_rng(5)
    held: dict[str, list[float]] = {}
    variances, counts = [], []
    for _ in range(DRAWS):
        maps = np.stack([GRID.spread(one) for one in drawn(draw, count, correlation).T @ SHAPES + STEADY])
        places = {"time": STEP * np.arange(count), "y": GRID.y, "x": GRID.x}
        shares = {"opd": (("time", "y", "x"), maps), "weight": (("y", "x"), GRID.weight)}
        data = xarray.Dataset(shares, places, {"wavelength": WAVELENGTH, "remove": ""})
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = statistics(data, apertures=[0.02, 0.04], mode_count=1)
        assert any("independent" in str(one.message) for one in told) == (found.attrs["independent_count"] < 10.0)
        exact = dict(expected)
        if drawn is autoregressive:
            turn = 2.0 * np.pi * STEP * found.frequency.values
            density = 2.0 * STEP * (1.0 - correlation**2) / (1.0 + correlation**2 - 2.0 * correlation * np.cos(turn))
            density[[0, -1]] = np.nan  # one of them without the mean, and both one-sided by another factor
            exact["spectrum_opd"] = density * expected["opd_rms_unsteady"] ** 2
            exact["spectrum_jitter_x"] = density * expected["jitter_x"] ** 2
        for name, truth in exact.items():
            off = np.abs(found[name].values - truth) - 2.0 * found[f"{name}_error"].values
            held.setdefault(name, []).append(np.mean(off[np.isfinite(off)] <= 0.0))
        variances.append(float(found.opd_rms_unsteady) ** 2)
        counts.append(found.attrs["independent_count"])
    shares = {name: float(np.mean(values)) for name, values in held.items()}
    assert min(shares.values()) >= 1.0 - 3.1 / DRAWS, shares
    assert np.mean(list(shares.values())) >= 0.92, shares
    assert np.mean(variances) == pytest.approx(expected["opd_rms_unsteady"] ** 2, rel=0.2)
    assert (np.median(counts) < 10.0) == few
