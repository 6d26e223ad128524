"""Sums, differences, multiples and comparisons of wavefronts.

Errors of two wavefronts are independent, unless they are equal or of the same rays: then they add without canceling.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Generic, TypeVar

import numpy as np

from ..derived import key_of
from ..display.quantities import TOTAL, ErrorBudget, Quantity, root_sum_square
from ..display.shown import shown
from ..tracing.variants.causes import Variants
from ..tracing.variants.paths import Cause
from .changes import finer, of_changes, of_pixels
from .terms import weighted_mean

W = TypeVar("W", bound=Any)  # Wavefront, whose methods these are


def times(wave: W, factor: float) -> W:
    """Return a wavefront with its OPD, and the errors of it, times a number."""
    if not isinstance(factor, (int, float, np.number)):
        return NotImplemented
    varied = None if wave.varied is None else partial(_scaled, wave.varied, factor)
    budget = partial(_joined, (wave,), (factor,), sum) if varied is None else None
    known = None if wave.error_map is None else abs(factor) * wave.error_map
    return replace(wave, opd=wave.opd * factor, varied=varied, budget=budget, error_map=known, seconds={})


def divided(wave: W, number: float) -> W:
    """Return a wavefront with its OPD, and the errors of it, divided by a number; a ValueError refuses 0."""
    if isinstance(number, (int, float, np.number)) and number == 0:
        raise ValueError("a wavefront cannot be divided by 0: give another number")
    return times(wave, 1.0 / number) if isinstance(number, (int, float, np.number)) else NotImplemented


def minus(one: W, other: W) -> W:
    """Return the difference of two wavefronts; a ValueError refuses other pixels, pupils, directions, wavelengths."""
    return plus(one, other, -1.0)


def plus(one: W, other: W, sign: float = 1.0) -> W:
    """Return the sum of two wavefronts, dark where either is; a ValueError refuses what `minus` refuses."""
    if type(other) is not type(one):
        return NotImplemented
    if one is other or one.key == other.key:
        return times(one, 1.0 + sign)
    first, second = shared(one, other)
    join = sum if one.varied is not None and one.varied is other.varied else root_sum_square
    removed = tuple(name for name in one.removed if name in other.removed)
    budget = partial(_joined, (one, other), (1.0, sign), join)
    opd = first.opd + sign * second.opd
    maps = [wave.error_map for wave in (one, other)]
    known = None if any(error is None for error in maps) else np.hypot(*maps)
    return replace(first, opd=opd, removed=removed, plan=None, seconds={}, varied=None, budget=budget, error_map=known)


def shared(one: W, other: W) -> tuple[W, W]:
    """Return two wavefronts without the pixels that are dark in either of them.

    Raises:
        ValueError: Their pixels, pupils, directions or wavelengths differ, or no pixel is lit in both.
    """
    looks: list[Any] = [
        getattr(wave.pupil, "normal", None) if wave.direction is None else wave.direction for wave in (one, other)
    ]
    mine, theirs = ((wave.pixel, wave.wavelength) for wave in (one, other))
    if one.opd.shape != other.opd.shape or not np.allclose(mine, theirs, rtol=1e-9, atol=0.0):
        words = (
            f"{len(wave.opd)} pixels of {wave.pixel:.6g} m at {1e9 * wave.wavelength:.6g} nm" for wave in (one, other)
        )
        raise ValueError(f"the wavefronts have {' and '.join(words)}: make both with one pupil and wavelength")
    both = one.lit & other.lit
    alike = one.pupil is None or other.pupil is None or key_of(one.pupil) == key_of(other.pupil)
    alike = alike and (any(look is None for look in looks) or np.allclose(*looks))
    if not (alike and np.allclose(one.weight[both], other.weight[both], rtol=1e-9)):
        raise ValueError("the wavefronts are of different pupils or look directions: make both with the same pupil")
    result = []
    for wave in (one, other):
        weight, intensity = np.where(both, [wave.weight, np.asarray(wave.intensity)], 0.0)
        blocked = 1.0 - (1.0 - wave.blocked) * weight.sum() / wave.weight.sum()
        result.append(replace(wave, weight=weight, intensity=intensity, blocked=blocked))
    return result[0], result[1]


def _scaled(varied: Any, factor: float) -> Variants | None:
    result = varied()
    if result is None:
        return None
    causes = {
        name: Cause(*(tuple(one * factor for one in some) for some in (cause.known, cause.like, cause.draws)))
        for name, cause in result.causes.items()
    }
    return replace(result, base=result.base * factor, causes=causes)


def _joined(waves: tuple[W, ...], factors: tuple[float, ...], join: Any) -> ErrorBudget:
    """Return the error budget of a sum of multiples of wavefronts, by the causes that all of them have."""
    budgets = [{TOTAL: np.nan, **wave.error} for wave in waves]
    names = [name for name in budgets[0] if all(name in own for own in budgets)]
    sizes = {name: [abs(factor) * own[name] for factor, own in zip(factors, budgets, strict=True)] for name in names}
    return ErrorBudget({name: join(size) for name, size in sizes.items()})


@shown
@dataclass(frozen=True, eq=False, repr=False)
class WavefrontComparison(Generic[W]):
    """Two wavefronts over one pupil, `first` and `second`, and `difference`, the first minus the second."""

    first: W
    second: W
    difference: W

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """The numbers with their errors.

        "strehl_first", "strehl_second" and "strehl_change", the first minus the second; "opd_rms_first",
        "opd_rms_second" and "opd_rms_difference", the rms of the difference [m]; and "correlation", Pearson's of both
        OPDs over the pupil, NaN where either is flat.
        """
        one, other = shared(self.first, self.second)
        ratios = [wave.quantities["strehl"] for wave in (self.first, self.second)]
        rms = [wave.quantities["opd_rms"] for wave in (self.first, self.second, self.difference)]
        errors = [0.0, 0.0]
        if self.first is not self.second and self.first.key != self.second.key:
            parts = (
                of_changes(one, lambda wave: correlation(wave, other)),
                of_changes(other, lambda wave: correlation(one, wave)),
                of_pixels(one, lambda wave: correlation(wave, other if wave.pixel == other.pixel else finer(other))),
            )
            errors = [root_sum_square(map(float, some)) for some in ([one.error or 0.0 for one in ratios], parts)]
        return {
            "strehl_first": ratios[0],
            "strehl_second": ratios[1],
            "strehl_change": Quantity(ratios[0].value - ratios[1].value, errors[0]),
            **{f"opd_rms_{name}": size for name, size in zip(("first", "second", "difference"), rms, strict=True)},
            "correlation": Quantity(correlation(one, other), errors[1]),
        }

    def __repr__(self) -> str:
        """The numbers with their errors, lengths in nanometers."""
        shown = {name: one.scaled(1e9, "nm") if one.unit else one for name, one in self.quantities.items()}
        return "\n  ".join(["WavefrontComparison", *(f"{name}: {one}" for name, one in shown.items())])


def correlation(one: W, other: W) -> float:
    """Return the correlation of two OPD maps on the same pixels; NaN where either is flat."""
    (first, weight), (second, _) = one.samples, other.samples
    first, second = (values - weighted_mean(weight, values) for values in (first, second))
    size = float(np.sqrt(weighted_mean(weight, first**2) * weighted_mean(weight, second**2)))
    return float(weighted_mean(weight, first * second)) / size if size > 0.0 else float("nan")


def compare(wavefront: W, other: W) -> WavefrontComparison[W]:
    """Return both wavefronts, their difference, and Strehl ratios, rms and correlation with errors in `quantities`.

    `compare_wavefronts` compares runs and flows too.

    Raises:
        TypeError: `other` is no Wavefront.
        ValueError: The pixels, pupils, directions or wavelengths differ.
    """
    return WavefrontComparison(wavefront, other, wavefront - other)
