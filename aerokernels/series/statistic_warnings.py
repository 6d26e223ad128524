"""What a reader of statistics in time has to know of the maps they are made of: lost pixels, uneven times, few maps."""

import numpy as np

LOST = 1e-3  # share of the pupil that may be in no statistic
UNEVEN = 0.05  # share of the time that snapshots may have too much, where each counts once
FEW = 10.0  # independent snapshots below which errors are themselves uncertain


def lost_pixels(finite: np.ndarray, share: np.ndarray) -> str:
    """Return a warning of pixels that have a number in some snapshots but not in all; empty if these are few.

    Args:
        finite: Whether pixels have a number, shape (t, y, x).
        share: Their shares of the pupil, shape (y, x). Pixels that have no number in any snapshot do not count: a
            caller leaves them out on purpose.
    """
    share = np.where(finite.any(axis=0), share, 0.0)
    lost = (share * ~finite.all(axis=0)).sum() / share.sum()
    if not lost > LOST:
        return ""
    each = (share * ~finite).sum(axis=(1, 2)) / share.sum()
    worst = int(each.argmax())
    return (
        f"{100.0 * lost:.3g} % of the pupil is in no statistic, because it has no number in some of the snapshots, "
        f"{100.0 * each[worst]:.3g} % of it in snapshot {worst}: leave out such snapshots by dataset.isel(time=...), "
        "or take a smaller pupil"
    )


def uneven_times(time: np.ndarray) -> str:
    """Return a warning of times [s], shape (t,), for which means over snapshots are not means over time."""
    if len(time) < 3:
        return ""
    steps = np.diff(time)
    stands_for = 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))
    stands_for[[0, -1]] *= 2.0  # the ends stand for as much time on their other side
    shares = len(time) * stands_for / stands_for.sum()
    if not 0.5 * np.abs(shares - 1.0).mean() > UNEVEN:
        return ""
    return (
        f"the times are uneven, with steps of {steps.min():.3g} to {steps.max():.3g} s, and each snapshot counts once: "
        "numbers are means over the snapshots and not over time; for those interpolate the maps to even times by "
        "dataset.interp(time=...), or leave out snapshots where they are dense"
    )


def few_independent(independent: float, count: int) -> str:
    """Return a warning of maps that count as few independent ones, of `count` snapshots; empty if these suffice."""
    if not independent < FEW:
        return ""
    return (
        f"the statistics rest on {independent:.2g} independent snapshots (of {count}), fewer than {FEW:g}: they and "
        "their errors are uncertain; take snapshots over a longer time"
    )
