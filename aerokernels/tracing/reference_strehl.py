"""A pupil by the reference backend: the sums of the other backends' kernels, in NumPy."""

import time

import numpy as np

from ..rays import RayBundle
from .pupil_sums import PUPIL_OUTPUTS, fit_moments
from .status import RayStatus
from .trace import run_plan


def reduce_pupil(
    field, pupil, look, until, plan, wavelength, per_replicate, replicates, seed, with_tilt, by_radius=False
):
    """Trace a pupil and sum: moments (replicates, MOMENT_COUNT), phasors (replicates,), evaluations, seconds."""
    first, second = pupil.axes
    moments: list[list[float]] = []
    phasors: list[tuple[np.ndarray, ...]] = []
    start = time.perf_counter()
    for replicate in range(replicates):
        rays = RayBundle.collimated(pupil, per_replicate, direction=look, seed=seed * replicates + replicate)
        arrays, _ = run_plan(field, rays, plan, until, wavelength, PUPIL_OUTPUTS)
        good = arrays["status"] == RayStatus.OK
        x = (rays.position[good] - pupil.center) @ first
        y = (rays.position[good] - pupil.center) @ second
        opd = arrays["opd"][good]
        products = (np.ones_like(x), x, y, opd, x * x, x * y, y * y, x * opd, y * opd, opd * opd)
        worst = arrays["step_error"][good].max(initial=0.0)
        moments.append([*(np.sum(term) for term in products), worst, arrays["evaluation_count"].sum()])
        phasors.append((x, y, opd))
    rows = np.array(moments)
    tilt = fit_moments(rows.sum(axis=0))[1] if with_tilt else np.zeros(2)
    wave = 2j * np.pi / wavelength
    sums = np.array([np.sum(np.exp(wave * (w - tilt[0] * x - tilt[1] * y))) for x, y, w in phasors])
    return rows, sums, int(rows[:, 11].sum()), {"compile": 0.0, "kernel": time.perf_counter() - start}
