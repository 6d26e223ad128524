"""The state of the reference engine's rays in flight, and where a parabola first meets a surface."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Flight:
    """The state of rays in flight, one entry per ray.

    Constant: start [m], direction, side (1 or -1, so that side times the distance from the stop plane is negative
    before the plane), normal of the body where the ray leaves it, zero for other rays. State: along t [m], q [m],
    momentum P, work W [m], stretch S [m], cell. Errors: lever_arm [m] and gain, by which errors of direction and of
    position become errors of the optical path; error [m]. Counts: steps, evaluations, attempts. Ends: stopped (at the
    user's stop), left (the box), hit (the body), failed (not finite), spent (all steps).
    """

    start: np.ndarray
    direction: np.ndarray
    side: np.ndarray
    along: np.ndarray
    lever_arm: np.ndarray
    gain: np.ndarray
    cell: np.ndarray
    normal: np.ndarray = field(init=False)
    q: np.ndarray = field(init=False)
    momentum: np.ndarray = field(init=False)

    def __post_init__(self):
        """Start undisturbed."""
        count = len(self.start)
        self.q, self.momentum, self.normal = (np.zeros((count, 3)) for _ in range(3))
        self.work, self.stretch, self.error = np.zeros(count), np.zeros(count), np.zeros(count)
        self.steps, self.evaluations, self.attempts = (np.zeros(count, dtype=np.int64) for _ in range(3))
        self.stopped, self.left, self.hit, self.failed, self.spent = (np.zeros(count, dtype=bool) for _ in range(5))

    @property
    def going(self) -> np.ndarray:
        """Numbers of the rays that are still in flight."""
        return np.flatnonzero(~(self.stopped | self.left | self.hit | self.failed | self.spent))


def starting_momentum(ambient: float, contrast, direction, normal) -> np.ndarray:
    """Return the momenta n dr/ds of rays where they begin, minus `ambient` times their directions, shape (n, 3).

    Rays that leave the body, where `normal` is not zero, are refracted there; others keep their direction. A ray that
    would be reflected within the body runs along its surface.
    """
    before = ambient * np.sum(direction * normal, axis=1)
    twice = contrast * (2.0 * ambient + contrast)  # n^2 - a^2
    behind = np.sqrt(np.maximum(before**2 + twice, 0.0))
    leaves = before > 0.0
    kick = np.maximum(twice / np.where(leaves, before + behind, 1.0), -before)
    return np.asarray(np.where(leaves[:, None], kick[:, None] * normal, contrast[:, None] * direction))


def rising_root(v0, v1, v2, tolerance) -> np.ndarray:
    """Return the first h >= 0 at which v0 + v1 h + v2 h^2 rises through zero; inf if it does not, 0 if it is above."""
    known = np.isfinite(v0)
    v0 = np.where(known, v0, -1.0)
    disc = v1 * v1 - 4.0 * v2 * v0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rest = np.sqrt(np.maximum(disc, 0.0))
        forward = np.where(v1 + rest > 0.0, -2.0 * v0 / (v1 + rest), np.inf)
        back = np.where(v2 > 0.0, (rest - v1) / (2.0 * v2), np.inf)
        root = np.where(v1 >= 0.0, forward, back)
    root = np.where(disc < 0.0, np.inf, root)
    # A ray that is above only by rounding and moves inward is not outside.
    above = (v0 >= 0.0) & ((v1 > 0.0) | ((v1 == 0.0) & (v2 > 0.0)) | ((v0 > tolerance) & (disc < 0.0)))
    root = np.where(above, 0.0, root)
    return np.where(known, np.maximum(root, 0.0), np.inf)
