"""Compare the trace of a random bundle with the reference engine.

`check(case, engines)` compares status, end, direction, arc length and OPD. The limits are:

    OPD         the tolerance, for every ray whose status does not say otherwise
    direction   100 tolerances over a length of the box (error control weights a direction by the path it costs), and
                2e-6 rad in float32, 1e-8 in float64
    end, arc    the effect of such a direction, and 100 tolerances, at the angle at which the stop is met
    status      the same, except where moving a start by 1e-5 cells changes the reference's
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from aerokernels.tracing.stop import reached

from .bundle_draws import WAVE, Case, box_of

# Statuses of rays whose results the tracer itself marks as doubtful, or does not give.
FLAGGED = (RayStatus.TOLERANCE_NOT_MET, RayStatus.MAX_STEPS, RayStatus.NOT_FINITE)
# Cosine with the plane's normal below which a ray counts as parallel to it.
PARALLEL = 1e-9


@dataclass
class Finding:
    """An error of one ray; `size` is in units of the limit."""

    what: str
    ray: int
    size: float
    text: str


def sample_rows(result, count: int, seed: int) -> np.ndarray:
    """Rays to compare: those of the greatest own estimates, of the longest and shortest paths, and random others."""
    if count >= result.ray_count:
        return np.arange(result.ray_count)
    some = count // 6
    rows = [np.argsort(result.step_error)[-some:], np.argsort(result.arc_length)[-some:]]
    rows += [np.argsort(result.arc_length)[:some], np.argsort(np.abs(result.opd))[-some:]]
    rows.append(np.random.default_rng(seed).choice(result.ray_count, count - 4 * some, replace=False))
    return np.unique(np.concatenate(rows))


def check(case: Case, engines: Sequence[dict[str, str]], sample: int = 300) -> tuple[list[Finding], int, str]:
    """Return the errors of a case's rays, the number of rays compared, and the method that traced them.

    Each of `engines` holds a backend, and its device where that matters. `sample` rays of each are compared, all with
    one trace of the reference.
    """
    results = [trace(case.field, case.rays, **engine, **case.settings) for engine in engines]
    rows = np.unique(np.concatenate([sample_rows(result, sample, case.seed) for result in results]))
    settings = {**case.settings, "method": "adaptive", "precision": "float64"}
    expected = trace(case.field, case.rays[rows], backend="reference", **settings)
    findings = [one for result in results for one in _findings(case, result, rows, expected, settings)]
    return findings, len(rows), results[0].plan.method


def _findings(case: Case, result, rows: np.ndarray, expected, settings) -> list[Finding]:
    """Return the errors of one engine's rays."""
    rays, reported = case.rays[rows], result.status[rows]
    findings = _statuses(case, rows, rays, reported, expected.status, settings)
    both = reached(reported) & reached(expected.status) & ~_hopeless(case, rays)
    low, high = box_of(case.field)
    extent = float(np.linalg.norm(high - low))
    allowed = case.settings["tolerance"] * WAVE
    obliquity = _obliquity(case, expected)
    turn = 100.0 * allowed / extent + (2e-6 if case.settings["precision"] == "float32" else 1e-8)
    lengths = extent + np.linalg.norm(expected.position - 0.5 * (low + high), axis=1)
    place = (100.0 * allowed + turn * lengths + 1e-12 * np.abs(rays.position).max()) * obliquity
    apart = {
        "opd": np.abs(result.opd[rows] - expected.opd) / allowed,
        "direction": np.abs(result.direction[rows] - expected.direction).max(axis=1) / turn,
        "end": np.linalg.norm(result.position[rows] - expected.position, axis=1) / place,
        "arc": np.abs(result.arc_length[rows] - expected.arc_length) / place,
    }
    for what, size in apart.items():
        wrong = np.flatnonzero(both & ~(size <= 1.0) & ~np.isin(reported, FLAGGED))
        for k in wrong[_decided(case, rays[wrong], expected.opd[wrong], settings)] if len(wrong) else wrong:
            own = result.step_error[rows[k]] / WAVE
            off, away = result.opd[rows[k]] - expected.opd[k], result.position[rows[k]] - expected.position[k]
            text = (
                f"OPD off by {off / WAVE:.2e} wave of {expected.opd[k] / WAVE:.2e} (own estimate {own:.1e}), "
                f"end by {np.linalg.norm(away):.1e} m"
            )
            findings.append(Finding(what, int(rows[k]), float(size[k]), f"{text}, {result.plan.backend}"))
    return findings


def _decided(case: Case, rays, opd, settings) -> np.ndarray:
    """Whether the result is stable when starts move by 1e-9 cells: rays in a face of the box may leave it or not."""
    rng = np.random.default_rng(case.seed)
    move = 1e-9 * np.min(case.field.spacing) * rng.uniform(-1.0, 1.0, rays.position.shape)
    decided = np.ones(rays.ray_count, dtype=bool)
    for moved in (rays.position + move, rays.position - move):
        other = trace(case.field, RayBundle(moved, rays.direction), backend="reference", **settings)
        decided &= reached(other.status) & (np.abs(other.opd - opd) < 0.1 * case.settings["tolerance"] * WAVE)
    return decided


def _hopeless(case: Case, rays) -> np.ndarray:
    """Rays within three degrees of their plane: they meet it hundreds of box sizes away, where rounding decides."""
    until = case.settings["until"]
    if not isinstance(until, Plane):
        return np.zeros(rays.ray_count, dtype=bool)
    return np.abs(rays.direction @ until.normal) < 0.05


def _obliquity(case: Case, expected) -> np.ndarray:
    """One over the cosine at which the rays meet their stop, at most 20."""
    until = case.settings["until"]
    if isinstance(until, Plane):
        cosine = np.abs(expected.direction @ until.normal)
    elif until is None:
        inward = 1e-9 * np.abs(case.field.spacing).min()
        low, high = case.field.box
        place, along = expected.position, np.abs(expected.direction)
        on = np.minimum(np.abs(place - low), np.abs(place - high)) < np.maximum(inward, 1e-9 * np.abs(place).max())
        cosine = np.where(on, along, 1.0).min(axis=1)
        if case.field.geometry == "axisymmetric":
            radius = np.hypot(place[:, 0], place[:, 1])
            outward = np.abs(np.einsum("nk,nk->n", place[:, :2], expected.direction[:, :2])) / np.maximum(
                radius, 1e-300
            )
            cosine = np.where(np.abs(radius - high[0]) < 1e-6 * high[0], outward, np.where(on[:, 2], along[:, 2], 1.0))
    else:
        cosine = np.ones(len(expected.status))
    return 1.0 / np.maximum(cosine, 0.05)


def _statuses(case: Case, rows, rays, reported, right, settings) -> list[Finding]:
    """Rays whose status differs from the reference's, where rounding does not decide it."""
    same = (reported == right) | (reached(reported) & reached(right)) | (reported == RayStatus.MAX_STEPS)
    wrong = np.flatnonzero(~same & (right != RayStatus.MAX_STEPS))
    if not len(wrong):
        return []
    rng, few = np.random.default_rng(case.seed), rays[wrong]
    aside, turn = rng.uniform(-1.0, 1.0, (2, *few.position.shape))
    # Rounding decides whether a ray that is parallel to its plane meets it at all.
    decided = np.ones(len(wrong), dtype=bool)
    if isinstance(settings.get("until"), Plane):
        decided = np.abs(few.direction @ settings["until"].normal) > PARALLEL
    for size in (1e-9, -1e-9, 1e-5, -1e-5):
        moved = few.position + size * np.min(case.field.spacing) * aside
        turned = few.direction + 1e-3 * size * turn
        other = trace(case.field, RayBundle(moved, turned), backend="reference", **settings).status
        decided &= other == right[wrong]
    name = {int(status): status.name for status in RayStatus}
    return [
        Finding("status", int(rows[k]), np.inf, f"{name[int(reported[k])]}, not {name[int(right[k])]}")
        for k in wrong[decided]
    ]
