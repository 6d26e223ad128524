"""The data of the paper's tables and figures: echoes of every scene, schlieren pictures of every flow."""

from dataclasses import dataclass

import numpy as np

from aerokernels import flow
from aerokernels.benches import SchlierenImage
from aerokernels.benches.knife_edge import schlieren
from aerokernels.compare import WaveformComparison, compare_waveforms
from aerokernels.lidar import EchoResult
from aerokernels.lidar.simulate import echo
from aerokernels.medium import IndexField
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene

from .printed import MACH

DENSITIES = {"tunnel": "wind-tunnel", "atmospheric": "sea-level"}
# The detection chain of the recorded waveforms. The paper does not state it: a usual amplifier and oscilloscope.
RECORDER = {
    "detector.noise": True,
    "detector.bandwidth": "200 MHz",
    "detector.bit_count": 12,
    "detector.sample_rate": "2 GHz",
}


@dataclass(frozen=True, eq=False)
class Case:
    """One Mach number at one density.

    Attributes:
        mach: Mach number, 0 for no flow.
        density: Free-stream density [kg/m3].
        ideal: The echo of the scene as shipped: no noise, unlimited bandwidth.
        recorded: The echo through the recorder's chain, with noise and its range statistics.
    """

    mach: int
    density: float
    ideal: EchoResult
    recorded: EchoResult


def scene_name(density: str, mach: int) -> str:
    """Name of the shipped scene; without flow there is one for both densities, in sea-level air."""
    return f"{DENSITIES[density]}-mach{mach}" if mach else "wind-tunnel-static"


def run_case(density: str, mach: int, trial_count: int, pupil_rays: int) -> Case:
    """Both echoes of one scene."""
    settings = {"receiver.ray_count": pupil_rays}
    scene = Scene.load(scene_name(density, mach), settings)
    prepared = prepare_field(scene)
    recorder = Scene.load(scene_name(density, mach), settings | RECORDER | {"detector.trial_count": trial_count})
    return Case(
        mach,
        prepared.density.ambient_density,
        echo(scene, field=prepared.field),
        echo(recorder, field=prepared.field),
    )


def run_cases(trial_count: int, pupil_rays: int, say=lambda words: None) -> dict[str, dict[int, Case]]:
    """Every case by density and Mach number."""
    cases: dict[str, dict[int, Case]] = {}
    for density in DENSITIES:
        cases[density] = {}
        for mach in MACH:
            if mach == 0 and density != "tunnel":
                cases[density][mach] = cases["tunnel"][mach]
                continue
            say(f"echo: {scene_name(density, mach)}")
            cases[density][mach] = run_case(density, mach, trial_count, pupil_rays)
    return cases


def compare_cases(test: Case, simulated: Case) -> WaveformComparison:
    """Compare the recorded echo of one case with the noise-free echo of another, through the same chain."""
    return compare_waveforms(test.recorded.time, test.recorded.voltage, simulated.recorded.clean_voltage)


def lag_of_correlation(case: Case, correlation: float) -> float:
    """Time shift [s] at which the correlation of an echo with itself, over its record, falls to `correlation`."""
    from scipy.interpolate import make_interp_spline
    from scipy.optimize import brentq

    time, voltage = case.recorded.time, case.recorded.clean_voltage
    curve = make_interp_spline(time, voltage, k=3)

    def shifted(lag: float) -> np.ndarray:
        return curve(np.clip(time - lag, time[0], time[-1]))

    return float(brentq(lambda lag: np.corrcoef(voltage, shifted(lag))[0, 1] - correlation, 0.0, 10e-9))


@dataclass(frozen=True, eq=False)
class Shadow:
    """The schlieren picture of one flow, and quantities measured in it.

    Attributes:
        mach: Mach number.
        image: The picture, light along x, the model's nose toward positive z.
        outline: The model's outline, z and y [m], shape (k, 2).
        bow_angle: Angle of the first shock to the axis, between 20 and 60 mm behind the nose [rad].
        stand_off: Distance of the first shock ahead of the nose [m].
        shocks: For each shock of `SHOCKS` the deflection across the edge [rad] and the density step [kg/m3].
    """

    mach: int
    image: SchlierenImage
    outline: np.ndarray
    bow_angle: float
    stand_off: float
    shocks: dict[str, tuple[float, float]]


# The part of the flow in the picture: z and y [m].
VIEW = (-0.130, 0.012, -0.085, 0.085)
BOW_REACH = (-60e-3, -20e-3)  # z between which the first shock's angle is fitted [m]
# z between which each shock's strength is measured [m], where it lies apart from the others at Mach 2 to 4, and which
# of the dark lines in a column it is, from the axis outward.
SHOCKS = {"bow": (-30e-3, 0.0, -1), "nose cone": (-60e-3, -45e-3, 0), "step": (-105e-3, -90e-3, 0)}
SHOCK_WIDTH = 3e-3  # on either side of a dark line, between which the density step is taken [m]


def shadow(mach: int, grid: IndexField, pixels: int, sensitivity: float | None = None) -> Shadow:
    """Trace the picture of a shipped flow, whose index is `grid`, see `picture_grid`."""
    body = flow.shipped(f"mach{mach}").body
    assert body is not None
    image = schlieren(grid, extent=VIEW, pixel_count=pixels, knife_edge="vertical", sensitivity=sensitivity)
    angle, stand_off = read_bow_shock(image)
    profile = body.profile
    outline = np.concatenate([profile[:, ::-1], profile[::-1, ::-1] * (1.0, -1.0)])
    return Shadow(mach, image, outline, angle, stand_off, read_shocks(image, grid))


def picture_grid(mach: int, spacing: float, density: float | None = None) -> IndexField:
    """The index of a shipped flow on a grid of a spacing [m], at its own density or another [kg/m3], over VIEW."""
    field = flow.shipped(f"mach{mach}")
    index = (field if density is None else field.scaled(density)).index_field(905e-9, "paper")
    low, high = (corner[1:] for corner in index.box)
    region = ((0.0, max(VIEW[0] - 1e-3, float(low[1]))), (min(0.12, float(high[0])), float(high[1])))
    return index.resample(spacing, region=region)


def read_bow_shock(image: SchlierenImage) -> tuple[float, float]:
    """Angle [rad] and stand-off [m] of the outermost shock of a picture.

    In each column it is the place nearest to the free stream where the deflection exceeds a quarter of its maximum.
    """
    bend = np.nan_to_num(np.hypot(image.deflection[..., 0], image.deflection[..., 1]))
    z, y = image.horizontal, image.vertical
    columns = np.flatnonzero((z > BOW_REACH[0]) & (z < BOW_REACH[1]))
    upper = y > 0.0
    height = []
    for column in columns:
        strength = bend[upper, column]
        height.append(y[upper][np.flatnonzero(strength > 0.25 * strength.max())[-1]])
    slope = np.polyfit(z[columns], height, 1)[0]
    middle = np.abs(y) < 1.5 * (y[1] - y[0])
    ahead = np.flatnonzero(z > 0.0)
    strength = bend[middle][:, ahead].mean(axis=0)
    deflecting = np.flatnonzero(strength > 0.25 * strength.max())
    return float(np.arctan(-slope)), float(z[ahead][deflecting[-1]])


def read_shocks(image: SchlierenImage, grid: IndexField) -> dict[str, tuple[float, float]]:
    """Strength of each shock of `SHOCKS` in a picture of `grid`: deflection [rad] and density step [kg/m3].

    Both are means over the columns of the shock's reach. In a column the deflection is the greatest across the edge, as
    the picture shows it, and the step is the density's rise across that place, of the index from which it was made.
    """
    from scipy.signal import find_peaks

    constant = flow.gladstone_dale_constant(905e-9)
    upper = image.vertical > 0.0
    y = image.vertical[upper]
    found = {}
    for name, (rear, front, which) in SHOCKS.items():
        strengths, steps = [], []
        for column in np.flatnonzero((image.horizontal >= rear) & (image.horizontal <= front)):
            darkening = np.nan_to_num(-image.deflection[upper, column, 0])
            place = find_peaks(darkening, prominence=0.1 * darkening.max())[0][which]
            behind, ahead = (y[place] + np.linspace(0.0, side * SHOCK_WIDTH, 31) for side in (-1.0, 1.0))
            contrast = [
                grid.contrast_at(np.stack([0.0 * r, r, np.full(r.shape, image.horizontal[column])], axis=1))
                for r in (behind, ahead)
            ]
            strengths.append(darkening[place])
            steps.append((contrast[0].max() - contrast[1].min()) / constant)
        found[name] = float(np.mean(strengths)), float(np.mean(steps))
    return found
