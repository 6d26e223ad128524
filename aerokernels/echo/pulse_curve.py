"""A sampled pulse as a smooth curve: crossings, peak and centroid between the samples.

The curve is the quintic spline through the samples (of lower degree for fewer than six): for a Gaussian pulse of
1/e half-width tau its error is of order (period / tau)^6, 2e-6 of the peak at six samples per tau, where linear
interpolation is off by 2e-2. Places are counted in samples from the start of the record, whatever the sample period.
"""

from functools import cached_property

import numpy as np

# The centroid is taken where the pulse stands above this share of its peak: farther out there is only noise.
CENTROID_FLOOR = 0.1
# This many equal samples at the top are not a peak between two samples but a level that was not passed.
PLATEAU = 3


class PulseCurve:
    """The curve through the samples of a pulse, shape (n,); places in samples, values in the samples' unit.

    Raises:
        ValueError: No sample is positive (in `peak_place` and what needs it), or the pulse's peak is cut off.
    """

    def __init__(self, samples: np.ndarray):
        """Fit the spline."""
        from scipy.interpolate import make_interp_spline

        self.samples = samples
        degree = min(5, 2 * ((samples.size - 2) // 2) + 1)
        self.spline = make_interp_spline(np.arange(samples.size), samples, k=degree)

    @cached_property
    def peak_place(self) -> float:
        """Where the curve is greatest, next to the greatest sample."""
        from scipy.optimize import minimize_scalar

        top = int(np.argmax(self.samples))
        if self.samples[top] <= 0.0:
            raise ValueError(f"there is no pulse: the greatest sample is {self.samples[top]:g} V; is the sign turned?")
        if top in (0, self.samples.size - 1):
            where = "first" if top == 0 else "last"
            raise ValueError(f"the greatest sample is the record's {where}: record from before the pulse to after it")
        found = minimize_scalar(
            lambda shift: -float(self.spline(top + shift)),
            bounds=(-1.0, 1.0),
            method="bounded",
            options={"xatol": 1e-10},
        )
        return top + float(found.x) if -found.fun > self.samples[top] else float(top)

    @cached_property
    def peak(self) -> float:
        """Greatest value of the curve."""
        return float(self.spline(self.peak_place))

    def _root(self, level: float, low: float, high: float) -> float:
        from scipy.optimize import brentq

        return float(brentq(lambda place: float(self.spline(place)) - level, low, high, xtol=1e-12))

    def first_rise(self, level: float) -> float:
        """First place at which the curve rises through `level`.

        Raises:
            ValueError: The curve starts above the level, or never reaches it.
        """
        if self.samples[0] >= level:
            raise ValueError(
                f"the record starts at {self.samples[0]:g} V, above the threshold of {level:g} V already: "
                "begin the record earlier, remove its offset, or raise the threshold"
            )
        above = self.samples >= level
        if above.any():
            after = int(np.argmax(above))
            return self._root(level, after - 1, after)
        if self.samples.max() <= 0.0 or self.peak < level:
            top = max(float(self.samples.max()), self.peak if self.samples.max() > 0.0 else -np.inf)
            raise ValueError(
                f"the signal never crosses the threshold: its peak is {top:g} V, the threshold {level:g} V; "
                "lower the threshold or raise the gain"
            )
        return self._root(level, np.ceil(self.peak_place) - 1.0, self.peak_place)  # the peak stands between two samples

    def rise_before_peak(self, level: float) -> float:
        """Last place before the peak at which the curve rises through `level` (below the peak).

        Raises:
            ValueError: The curve stands above the level from the record's start on.
        """
        before = np.flatnonzero(self.samples[: int(np.ceil(self.peak_place))] < level)
        if before.size == 0:
            raise ValueError(
                f"the record starts above {level:g} V, within the pulse: begin it earlier or remove its offset"
            )
        return self._root(level, before[-1], min(before[-1] + 1.0, self.peak_place))

    def fall_after_peak(self, level: float) -> float:
        """First place after the peak at which the curve falls through `level`; the record's end if there is none."""
        start = int(np.floor(self.peak_place)) + 1
        after = np.flatnonzero(self.samples[start:] < level)
        if after.size == 0:
            return float(self.samples.size - 1)
        low = start + int(after[0])
        return self._root(level, max(low - 1.0, self.peak_place), low)

    @cached_property
    def centroid(self) -> float:
        """Mean place, weighted with the curve, of the part that stands above `CENTROID_FLOOR` of the peak."""
        level = CENTROID_FLOOR * self.peak
        low = 0.0 if self.samples[0] >= level else self.rise_before_peak(level)
        high = self.fall_after_peak(level)
        area = self.spline.antiderivative(1)
        moment = self.spline.antiderivative(2)
        # Integration by parts; places counted from the peak, so that long records lose no digits.
        lever = (high - self.peak_place) * area(high) - (low - self.peak_place) * area(low)
        return self.peak_place + float((lever - (moment(high) - moment(low))) / (area(high) - area(low)))

    @property
    def slope(self) -> np.ndarray:
        """Derivative at the samples [unit per sample], shape (n,)."""
        return np.asarray(self.spline.derivative()(np.arange(self.samples.size)))


def peak_height(samples: np.ndarray, made: PulseCurve | None = None) -> float:
    """Greatest value of the curve through the samples, which may have been made already.

    It is the greatest sample where the record holds no peak, and where an amplifier or a digitiser has cut the peak
    off: the curve would overshoot at the edges of such a plateau.
    """
    top = int(np.argmax(samples))
    cut_off = bool((samples[top : top + PLATEAU] == samples[top]).all()) and top + PLATEAU <= samples.size
    if samples[top] <= 0.0 or top in (0, samples.size - 1) or cut_off:
        return float(samples[top])
    return (made or PulseCurve(samples)).peak
