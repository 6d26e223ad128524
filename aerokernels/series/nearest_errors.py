"""For which snapshots of a series the errors are computed, and what the others take.

Snapshots at every k-th place have errors of their own, where k is the least power of two for which there are at most
MOST, and not below LEAST_STEP; so have those whose wavefront is much steeper or flatter than it was when that was last
so. Each other one takes the errors of the nearest of these in time. A series that has grown has the errors of one that
was as long from the start, because its places are among those of the shorter one.
"""

import numpy as np

# Places with errors of their own; least number of snapshots from one to the next, for which errors take little of the
# time; most other snapshots with errors of their own.
MOST, LEAST_STEP, MOST_MORE = 8, 128, 8
# Factor of the slopes' mean square by which a wavefront is another one.
OTHER = 3.0


class Chosen:
    """Says of one snapshot after another whether errors are computed for it."""

    def __init__(self, total: int):
        """Begin with the first snapshot of `total`."""
        self._step = LEAST_STEP
        while self._step * MOST < total:
            self._step *= 2
        self._number, self._more, self._slope = 0, 0, np.nan

    def __call__(self, slope: float) -> bool:
        """Whether the next snapshot is one of them; `slope` is the mean square of its wavefront's slopes."""
        other = self._number > 0 and not self._slope / OTHER <= slope <= self._slope * OTHER
        other = other and self._more < MOST_MORE
        if other or self._number == 0:
            self._slope = slope
        self._more += other
        self._number += 1
        return bool((self._number - 1) % self._step == 0 or other)


def nearest_in_time(errors: np.ndarray, slopes: np.ndarray, total: int) -> np.ndarray:
    """Return errors of all snapshots, shape (n,), of which those that were not computed are NaN.

    Args:
        errors: As they were computed, NaN elsewhere, shape (n,).
        slopes: Mean squares of the wavefronts' slopes, shape (n,).
        total: Number of snapshots of the series.
    """
    chosen = Chosen(total)
    known = np.flatnonzero([chosen(slope) for slope in slopes])
    known = known[np.isfinite(errors[known])]
    if not len(known):
        return np.full(len(errors), np.nan)
    place = np.arange(len(errors))
    return np.asarray(errors[known[np.abs(place[:, None] - known).argmin(axis=1)]])
