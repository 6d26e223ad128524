"""Compute the Strehl ratio from the sums over a pupil's rays, and detect rays that met no disturbed air."""

from typing import Any

import numpy as np

from ..medium import IndexField
from ..tracing.lines import box_size
from ..tracing.meeting import greatest_contrast
from ..tracing.pupil.fit import rms_about

# Fraction of the tolerance below which an optical path difference counts as zero.
UNSEEN = 1e-3


class NoRayArrived(ValueError):
    """A pupil of which no ray arrived beyond the field: it has no Strehl ratio."""


def combined(
    total: np.ndarray, phasor: np.ndarray, wavelength: float, remove: tuple[str, ...], fit: Any = None
) -> dict[str, float]:
    """Return ratio, Marechal's approximation and rms OPD from the sum of all replicates' moments and their phasors.

    `fit` is the result of `fit_moments` for these moments, if it is known.

    Raises:
        NoRayArrived: No ray arrived beyond the field.
    """
    if total[0] == 0:
        raise NoRayArrived(
            "no ray of the pupil arrived beyond the field: all met the body or left their path; "
            "move the pupil, or turn its normal toward the flow"
        )
    rms = rms_about(total, remove, fit)
    value = float(np.abs(np.add.reduce(phasor) / total[0]) ** 2)
    return {
        "value": value,
        "marechal": float(np.exp(-((2.0 * np.pi * rms / wavelength) ** 2))),
        "opd_rms": rms,
    }


def met_nothing(field: IndexField, size: float, wavelength: float, tolerance: float) -> bool:
    """Return whether no ray met the field's contrast although it could matter; `size` is the rays' OPD [m]."""
    if size > UNSEEN * tolerance * wavelength:
        return False
    return greatest_contrast(field) * box_size(field) > tolerance * wavelength
