"""Series of flows seen through a pupil: maps, their errors and statistics; maps over look angles; an interferometer."""

import numpy as np
import pytest
import xarray

from aerokernels import FLDI, Disc, fldi_response, flow, look_map, optical_series, statistics
from aerokernels.series.line_integrals import LineIntegrals
from aerokernels.series.linking import linking_equation
from tests.draws.fldi_draws import draw_reading
from tests.series.fourier import Fourier

from .records import Nudge
from .scenes import SINGLE, ball, nudged

pytestmark = pytest.mark.filterwarnings("ignore")
STAGES = ("series/", "fldi/")
SHAPE, SPACING, ORIGIN = (17, 17, 13), 6.25e-3, (-0.05, -0.05, 0.0)


def opened(nudge: Nudge, geometry: str, count: int = 3) -> flow.Series:
    """Waves that are carried along."""
    times = 1e-5 * np.arange(count)
    field = Fourier.random(1)
    arrays = [nudge(field.on_grid(ORIGIN, SPACING, SHAPE, t)) for t in times]
    first = 3 - {"volume": 3}.get(geometry, 2)
    arrays = [array if geometry == "volume" else array[8] for array in arrays]
    origin = (0.0, 0.0) if geometry == "axisymmetric" else ORIGIN[first:]
    options = {"geometry": geometry, "origin": origin, "spacing": [SPACING] * (3 - first)}
    return flow.open_series(arrays, time=times, ambient_density=field.mean, **options)


def numbers(found: xarray.Dataset) -> dict:
    """The arrays of a dataset."""
    return {name: np.asarray(one.values) for name, one in found.variables.items() if one.dtype.kind in "fiub"}


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.15, 0.1, 1.0)])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_maps(answers, geometry: str, direction, interpolation: str):
    """By line integrals, or by rays where they must be."""

    def case(nudge: Nudge):
        found = optical_series(
            opened(nudge, geometry),
            Disc(0.02, [0.0, 0.0, 0.004]),
            direction=direction,
            pixel_count=12,
            interpolation=interpolation,
            backend="opencl",
        )
        return numbers(found)

    answers(case, nudge=1e-9)


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
def test_lines(answers, interpolation: str):
    """Integrals along slanted lines by the planes that they cross."""

    def case(nudge: Nudge):
        series = opened(nudge, "volume", 1)
        start = np.c_[np.linspace(-0.02, 0.02, 6), np.linspace(0.01, -0.03, 6), np.full(6, 0.01)]
        direction = np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])
        lines = LineIntegrals(series.mesh, start, direction, interpolation)
        weights = [lines.path_weights, lines.lattice]
        return lines(nudge(np.random.default_rng(2).normal(size=SHAPE))), [
            one for one in weights if isinstance(one, np.ndarray)
        ]

    answers(case)


def some_maps(nudge: Nudge) -> xarray.Dataset:
    """Maps of 64 times on 8 x 9 pixels, of which some are dark."""
    rng = np.random.default_rng(3)
    x, y = 0.01 * np.arange(8), 0.01 * np.arange(9)
    wave = np.sin(40.0 * x[None, None] - 0.4 * np.arange(64)[:, None, None] + 30.0 * y[None, :, None])
    opd = nudge(1e-7 * wave + rng.normal(0.0, 2e-8, (64, 9, 8)))
    weight = np.where(np.hypot(x - 0.035, y[:, None] - 0.04) < 0.042, 1.0, 0.0)
    opd[:, weight == 0.0] = np.nan
    given = {"opd": (("time", "y", "x"), opd), "weight": (("y", "x"), weight / weight.sum())}
    return xarray.Dataset(given, {"time": 1e-5 * np.arange(64), "y": y, "x": x}, {"wavelength": 600e-9})


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"velocity": 300.0, "length": 0.05, "mode_count": 4, "segment": 16},
        {"apertures": [0.04, 0.06], "wavelength": 1e-6},
    ],
)
def test_statistics(answers, options: dict):
    """Means, spectra, modes, apertures and correlations."""
    answers(lambda nudge: numbers(statistics(some_maps(nudge), **options)))


def test_linking(answers):
    """The rms of the path from that of the density, with its errors."""

    def case(nudge: Nudge):
        points = np.array([[0.0, 0.0, 0.004], [0.01, 0.005, 0.004]])
        return linking_equation(opened(nudge, "volume", 8), points, (0.0, 0.0, 1.0), 600e-9)

    answers(case)


@pytest.mark.parametrize("geometry", ["volume", "axisymmetric"])
def test_looks(answers, geometry: str):
    """Strehl ratios and tilts over angles."""

    def case(nudge: Nudge):
        found = look_map(
            ball(nudge, geometry),
            [-0.3, 0.0, 0.2],
            [0.0, 0.1],
            Disc(0.008),
            ray_count=128,
            wavelength=600e-9,
            backend="opencl",
        )
        return numbers(found)

    answers(case, nudge=SINGLE)


@pytest.mark.parametrize("seed", range(3))
def test_interferometer(answers, seed: int):
    """Phases of a focused interferometer in random air, and their errors."""

    def case(nudge: Nudge):
        one = draw_reading(seed)
        return fldi_response(nudged(one.air.field, nudge), one.instrument)

    answers(case)


def test_instrument(answers):
    """Closed forms of an instrument, and a series of offsets."""

    def case(nudge: Nudge):
        one = FLDI(1.2e-4, nudge(6e-6), focus=(0.004, 0.0, 0.02), direction=(0.0, 1.0, 0.0))
        waves = np.geomspace(30.0, 3e4, 6)
        found = fldi_response(ball(nudge, "volume", 1e-6), one, offsets=[[0.0, 0.0, 0.0], [1e-3, 0.0, 2e-3]], rays=9)
        transfers = (
            one.transfer(waves),
            one.transfer(waves, 0.01, angle=0.3),
            one.transfer_through(waves, 0.02, angle=0.2),
        )
        return found, transfers, one.radius(np.array([0.0, 0.05])), one.normal, one.divergence

    answers(case)
