"""Status codes of rays. The first failure wins, and the failure of one ray does not affect the others."""

from enum import IntEnum

import numpy as np


class RayStatus(IntEnum):
    """Status codes of traced rays, the same numbers in every kernel."""

    OK = 0
    MISSED_FIELD = 1
    STOP_NOT_REACHED = 2
    HIT_BODY = 3
    INSIDE_BODY = 4
    MAX_STEPS = 5
    NOT_FINITE = 6
    LEFT_DISTURBED_AIR = 7
    TOLERANCE_NOT_MET = 8

    @property
    def meaning(self) -> str:
        """What happened."""
        return _TEXT[self][0]

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return _TEXT[self][1]


_TEXT = {
    RayStatus.OK: ("the ray reached the stop", "nothing to do"),
    RayStatus.MISSED_FIELD: (
        "the ray never meets the field's box, so it cannot leave it",
        "aim the ray at the box, or stop on a Plane or at an ArcLength",
    ),
    RayStatus.STOP_NOT_REACHED: (
        "the plane is behind the ray or parallel to it (within 1e-9 rad), or the ray was turned away from it",
        "move the plane ahead of the rays, or turn its normal",
    ),
    RayStatus.HIT_BODY: (
        "the ray met the body and ends on its surface",
        "expected for rays that the body blocks; else check the body's profile and the ray's start",
    ),
    RayStatus.INSIDE_BODY: (
        "the ray starts behind the body's surface and never leaves it within the field's box",
        "move the start, or turn the ray toward the surface",
    ),
    RayStatus.MAX_STEPS: (
        "the ray took as many steps as allowed and had not arrived",
        "raise max_steps, loosen the tolerance, or look for a ray that is trapped in the field",
    ),
    RayStatus.NOT_FINITE: (
        "a number overflowed or was not a number",
        "trace in float64, or look for contrasts that are too strong for the step",
    ),
    RayStatus.LEFT_DISTURBED_AIR: (
        "the ray reached the stop, but the field was cut from a larger one (resample(region=), or a scene's grid), "
        "whose disturbed air outside the box is missing from its optical path",
        "give the field a larger region, move the rays, or read `truncation`, which is what is missing",
    ),
    RayStatus.TOLERANCE_NOT_MET: (
        "the ray reached the stop, but its own error estimate (step_error) is above the requested tolerance",
        "trace in float64, loosen the tolerance, or read the ray's step_error",
    ),
}

# Code by which the kernels that interpolate rays mark one without a patch, until it is traced; not a RayStatus.
NOT_DELIVERED = -1

# Rays with these statuses reached the stop: their results can be used, with the reservation that the status states.
REACHED = (RayStatus.OK, RayStatus.LEFT_DISTURBED_AIR, RayStatus.TOLERANCE_NOT_MET)


def reached(status: np.ndarray) -> np.ndarray:
    """Which of the status codes belong to rays that reached the stop, as booleans of the same shape."""
    status = np.asarray(status)
    found = status == int(REACHED[0])
    if not found.all():
        for other in REACHED[1:]:
            found |= status == int(other)
    return np.asarray(found)
