"""Fields with structure between the traced lines of a bundle, to test the error of interpolated rays.

`hard_field(seed)` makes a field of one of KINDS; its position, size and strength depend on the seed alone.
`check(seed)` traces a bundle through it as `trace` does by default, and every ray again by error control in float64 at
a twentieth of the tolerance. A ray is worse than reported if its optical path has an error above the tolerance, and
neither its status nor the budget says so. Rays that cross at a caustic, and rays at a shock inside a cell, depend on
rounding of their start: a ray whose path changes by half of the tolerance when it is moved by a millionth of a cell is
ignored.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from aerokernels.tracing.status import reached

WAVE = 905e-9
CELL = 1e-3 / 16
NODES = 48
KINDS = ("needle", "one node", "shock", "layer's rim", "caustic", "noise", "waves", "random")
BUNDLES = ("slanted", "divergent", "convergent")
SIDE = 120  # rays along each side of a bundle
TOLERANCE, TIGHTER = 1e-3, 0.05
UNTIL = Plane((0.0, 0.0, 3e-3), (0.0, 0.1, 1.0))
# Causes of the budget that concern tracing; the field itself is defined by its samples.
TRACING_CAUSES = ("step", "precision", "bundle")
FLAGGED = (RayStatus.TOLERANCE_NOT_MET, RayStatus.MAX_STEPS, RayStatus.NOT_FINITE)


@dataclass(frozen=True)
class Checked:
    """The result of a seed.

    Attributes:
        kind: The kind of field and of bundle, in words.
        delivered: Rays that were interpolated.
        worst: The greatest error of a ray that arrives in both traces, over the tolerance.
        reported: The budget's error of tracing (TRACING_CAUSES), over the tolerance; 0 if it was not read.
        wrong: Rays whose error is above the tolerance and above the budget, without a status.
        statuses: Rays that arrive in only one of the traces.
    """

    kind: str
    delivered: int
    worst: float
    reported: float
    wrong: int
    statuses: int


def hard_field(seed: int) -> tuple[str, IndexField]:
    """Return the kind and the field of a seed."""
    rng = np.random.default_rng([seed, 16])
    kind = KINDS[seed % len(KINDS)]
    across = (np.arange(NODES) - 0.5 * (NODES - 1)) * CELL
    x, y, z = np.meshgrid(across, across, across, indexing="ij")
    depth = np.exp(-((z / 6e-4) ** 2))
    smooth = 10.0 ** rng.uniform(-5.0, -3.4) * depth * np.cos(x / 1e-3 + rng.uniform(0, 6)) * np.cos(y / 8e-4)
    u, v = rng.uniform(-7e-4, 7e-4, 2)
    drift = rng.uniform(-0.15, 0.15, 2)
    square = (x - u - drift[0] * z) ** 2 + (y - v - drift[1] * z) ** 2
    angle = rng.uniform(0.0, np.pi)
    side = np.cos(angle) * (x - u) + np.sin(angle) * (y - v) + drift[0] * z
    noise = rng.normal(size=x.shape)
    if kind == "needle":
        made = smooth + 10.0 ** rng.uniform(-6.0, -4.0) * depth * np.exp(-square / (rng.uniform(0.7, 1.2) * CELL) ** 2)
    elif kind == "one node":
        made = smooth
        made[tuple(rng.integers(8, NODES - 8, 3))] += 10.0 ** rng.uniform(-5.0, -3.5)
    elif kind == "shock":
        made = smooth + 10.0 ** rng.uniform(-5.0, -3.5) * depth * (side > 0.0)
    elif kind == "layer's rim":
        made = smooth + 1e-4 * depth * np.exp(-((np.sqrt(square) - 3e-4) ** 2) / (1.5 * CELL) ** 2)
    elif kind == "caustic":
        made = rng.uniform(2e-3, 8e-3) * np.exp(-((x - u) ** 2 + (y - v) ** 2 + z**2) / 6e-4**2)
    elif kind == "noise":
        made = smooth + 10.0 ** rng.uniform(-6.5, -4.7) * depth * noise
    elif kind == "waves":
        made = smooth + 10.0 ** rng.uniform(-6.0, -4.5) * depth * np.cos(
            side * 2.0 * np.pi / (rng.uniform(2.0, 9.0) * CELL)
        )
    else:
        some = gaussian_filter(noise, rng.uniform(1.0, 6.0), mode="constant")
        made = some * depth * 10.0 ** rng.uniform(-5.0, -3.3) / np.abs(some).max()
    interpolation = "monotone" if kind == "shock" and rng.random() < 0.3 else "cubic"
    return kind, IndexField.from_samples(
        made,
        origin=(across[0],) * 3,
        spacing=(CELL,) * 3,
        geometry="volume",
        ambient_index=1.00027,
        interpolation=interpolation,
        wavelength=WAVE,
    )


def hard_rays(seed: int) -> tuple[str, RayBundle]:
    """Return the kind of bundle of a seed, and its rays on a square grid ahead of the field."""
    rng = np.random.default_rng([seed, 17])
    bundle = BUNDLES[seed // len(KINDS) % len(BUNDLES)]
    across = np.linspace(-0.9e-3, 0.9e-3, SIDE)
    u, v = (axis.ravel() for axis in np.meshgrid(across, across, indexing="ij"))
    place = np.c_[u, v, np.full(u.size, -1.55e-3)]
    if bundle == "slanted":
        way = np.array([*rng.uniform(-0.1, 0.1, 2), 1.0])
        return bundle, RayBundle(place - 1.55e-3 * way * [1.0, 1.0, 0.0], way[None])
    apex = np.array([*rng.uniform(-2e-4, 2e-4, 2), rng.uniform(-30e-3, -15e-3)])
    return bundle, RayBundle(place, place - apex if bundle == "divergent" else apex * [1.0, 1.0, -1.0] - place)


def check(seed: int, **engine) -> Checked:
    """Trace the bundle of a seed both ways; `engine` holds the backend, and its device where that matters."""
    (kind, field), (bundle, rays) = hard_field(seed), hard_rays(seed)
    options = {"until": UNTIL, "outputs": ("opd", "step_error"), **engine}
    result = trace(field, rays, tolerance=TOLERANCE, **options)
    tight = {**options, "method": "adaptive", "precision": "float64", "tolerance": TIGHTER * TOLERANCE}
    truth = trace(field, rays, **tight)
    assert result.opd is not None and truth.opd is not None
    both = result.ok & truth.ok
    off = np.where(both, np.abs(result.opd - truth.opd), 0.0) / (TOLERANCE * WAVE)
    silent = both & ~np.isin(result.status, FLAGGED) & ~np.isin(truth.status, FLAGGED)
    suspect = np.flatnonzero(silent & (off > 1.0 + TIGHTER))
    reported = (
        float(np.hypot.reduce([result.error[cause] for cause in TRACING_CAUSES])) / (TOLERANCE * WAVE)
        if len(suspect)
        else 0.0
    )
    suspect = suspect[off[suspect] > max(reported, 1.0)]
    if len(suspect):
        beside = RayBundle(rays.position[suspect] + [1e-6 * CELL, 0.0, 0.0], rays.direction[suspect])
        moved = trace(field, beside, **tight)
        assert moved.opd is not None
        steady = np.abs(moved.opd - truth.opd[suspect]) <= 0.5 * TOLERANCE * WAVE
        suspect = suspect[steady & reached(moved.status)]
    counts = result.plan.bundle
    return Checked(
        f"{kind}, {bundle}",
        0 if counts is None else counts.delivered,
        float(off[silent].max(initial=0.0)),
        reported,
        len(suspect),
        int(np.count_nonzero(result.ok != truth.ok)),
    )
