"""Does the reported budget cover the error made? Random fields whose true optical paths are known from the formula.

Set-up: planar and volume fields on 24 to 64 nodes a side, sampled from a formula: "smooth" (random plane waves, 6 to 20
cells long), "shocked" (tanh layers, curved and aslant, 0.2 to 6 cells thick, over a smooth background) or "noisy"
(smooth plus white noise of the samples, which the truth does not have). Rays within 0.1 rad of the axis.

Truth: the exact ray of the formula by DOP853 at 1e-10.

Must hold: at least 95 % of the fields are covered by the reported total, and the median of reported over true is at
most 30. The counts are of 200 fields; a field counts as covered where the greatest error over its rays is below the
budget's total.
"""

import numpy as np
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.leapfrog import LEAST_RAYS

WAVE = 905e-9
CELL = 1e-4
FIELD_COUNT = 200
COMPARED = 24  # rays of a bundle whose truth is known
outcomes: list[tuple[str, float, float]] = []


def smooth_formula(rng, amplitude: float, longest: float, shortest: float):
    """A sum of plane waves in y and z [m] (and x), faded to nothing nowhere: value and slope across."""
    waves = [(rng.normal(size=3), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(shortest, longest)) for _ in range(5)]

    def value(x, y, z):
        total = 0.0
        for way, phase, length in waves:
            unit = way / np.linalg.norm(way)
            total = total + np.sin(2.0 * np.pi * (unit[0] * x + unit[1] * y + unit[2] * z) / length + phase)
        return amplitude * total / len(waves)

    return value


def shock_formula(rng, amplitude: float, thickness: float, middle: float):
    """A curved tanh layer aslant to the axis."""
    slant, curve, place = rng.uniform(-0.8, 0.8), rng.uniform(-100.0, 100.0), middle * rng.uniform(0.6, 1.4)
    tilt = rng.uniform(-0.3, 0.3)

    def value(x, y, z):
        distance = (z - place - slant * y - tilt * x - curve * y * y) / np.sqrt(1.0 + slant**2 + tilt**2)
        return amplitude * 0.5 * (1.0 + np.tanh(distance / thickness))

    return value


def exact_opd(value, rays: RayBundle, length: float, thinnest: float) -> np.ndarray:
    """OPD [m] on the plane z = length for rays from z = 0 in ambient index 1, by DOP853 on the formula.

    With z as the variable: x' = p_x / p_z, p_x' = (n / p_z) dn/dx, L' = n^2 / p_z, p_z^2 = n^2 - p_x^2 - p_y^2; slopes
    of n by complex steps, which are exact to rounding.
    """
    ray_count = rays.ray_count

    def rate(z, state):
        x, y, px, py, _ = state.reshape(5, ray_count)
        hair = 1e-20
        # Both slopes by one call: for few rays it is calls that cost.
        ahead = value(np.stack([x + 1j * hair, x + 0j]), np.stack([y + 0j, y + 1j * hair]), z)
        index = 1.0 + ahead[0].real
        pz = np.sqrt(index**2 - px**2 - py**2)
        slopes = ahead.imag / hair
        # L' less its value on the straight ray: the small number itself is integrated.
        return np.concatenate(
            [
                px / pz,
                py / pz,
                index / pz * slopes[0],
                index / pz * slopes[1],
                index**2 / pz - 1.0 / rays.direction[:, 2],
            ]
        )

    x, y = rays.position[:, :2].T
    start_index = 1.0 + value(x, y, 0.0)
    start = np.concatenate([x, y, start_index * rays.direction[:, 0], start_index * rays.direction[:, 1], 0.0 * x])
    solution = solve_ivp(
        rate, (0.0, length), start, method="DOP853", rtol=1e-10, atol=1e-15, max_step=min(2.0 * CELL, thinnest)
    )
    return solution.y[-ray_count:, -1]


@seed(20261121)
@settings(max_examples=FIELD_COUNT, deadline=None, database=None)
@given(st.sampled_from(["smooth", "shocked", "noisy"]), st.booleans(), st.integers(0, 2**31))
def collect(kind, in_volume, number):
    """Trace one random field and note what was reported and what was true."""
    rng = np.random.default_rng(number)
    count = rng.integers(24, 64)
    amplitude = 10.0 ** rng.uniform(-5.0, -3.3)
    size = CELL * (count - 1)
    z = CELL * np.arange(count)
    y = z - 0.5 * size
    thickness = CELL * 10.0 ** rng.uniform(np.log10(0.2), np.log10(6.0)) if kind == "shocked" else size
    shortest = CELL * rng.uniform(6.0, 12.0)
    background = smooth_formula(rng, amplitude * (0.3 if kind == "shocked" else 1.0), 2.0 * shortest, shortest)
    layer = shock_formula(rng, amplitude, thickness, 0.5 * size) if kind == "shocked" else None

    def value(px, py, pz):
        total = background(px, py, pz)
        return total if layer is None else total + layer(px, py, pz)

    interpolation = str(rng.choice(["cubic", "cubic", "linear", "monotone"]))
    if in_volume:
        nodes = np.meshgrid(y, y, z, indexing="ij")
        geometry, origin = "volume", (y[0], y[0], 0.0)
        samples = value(*nodes)
    else:
        nodes = np.meshgrid(y, z, indexing="ij")
        flat = value
        value = lambda px, py, pz: flat(0.0 * px, py, pz)  # noqa: E731
        geometry, origin = "planar", (y[0], 0.0)
        samples = value(np.zeros_like(nodes[0]), *nodes)
    if kind == "noisy":
        samples = samples + 0.05 * amplitude * rng.standard_normal(samples.shape)
    field = IndexField.from_samples(
        samples, origin=origin, spacing=(CELL,) * samples.ndim, geometry=geometry, interpolation=interpolation
    )
    # Every other time on a cubic grid as many as take the way of a million rays, by leapfrog samples; else a few, which
    # go one by one, as all do on other grids.
    ray_count = LEAST_RAYS if interpolation == "cubic" and number % 2 else COMPARED
    position = np.c_[rng.uniform(-0.3, 0.3, (ray_count, 2)) * size, np.zeros(ray_count)]
    slope = rng.uniform(-0.1, 0.1, (ray_count, 2))
    rays = RayBundle(position, np.c_[slope, np.ones(ray_count)])
    result = trace(field, rays, until=Plane((0.0, 0.0, float(z[-1])), (0.0, 0.0, 1.0)))
    assert result.ok.all()
    exact = exact_opd(value, rays[:COMPARED], float(z[-1]), thickness)
    true = float(np.abs(result.opd[:COMPARED] - exact).max())
    outcomes.append((kind + " " + interpolation, result.error["total"], true))


def test_two_hundred_random_fields():
    outcomes.clear()
    collect()
    reported = np.array([row[1] for row in outcomes])
    true = np.array([row[2] for row in outcomes])
    assert len(outcomes) >= FIELD_COUNT
    assert np.mean(reported >= true) >= 0.95
    assert np.median(reported / true) <= 30.0
