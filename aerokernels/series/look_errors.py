"""The errors of the numbers of look directions: computed for a few, of which each other one takes the nearest's.

The few are spread over the map: the strongest first, and then whichever is farthest from all before it. Distance is
that of the directions, as unit vectors, and of the decimal logarithms of the OPD rms, so that a direction through
strong air does not take the errors of one beside it. The sampling errors are each direction's own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# Directions of which errors are computed; an OPD rms below this share of the greatest one counts as that.
FEW, WEAKEST = 8, 1e-4
# Places of the numbers in wavefront/pupil_numbers.py.
STREHL, RMS, TILT = 0, 2, slice(3, 5)


@dataclass(eq=False)
class Look:
    """What is known of a direction.

    Attributes:
        numbers: "strehl", "strehl_standard_error", "opd_rms" [m], "blocked" and "known".
        axes: The pupil's two axes, shape (2, 3).
        tilt: The beam's deflection along them [rad], shape (2,).
        met: Whether the pupil looks through the flow.
        sampling: Errors of PupilNumbers' numbers by the number of rays, shape (5,).
        model: Computes those by all other causes, shape (5,); None where there are none.
    """

    numbers: dict[str, float]
    axes: np.ndarray
    tilt: np.ndarray
    met: bool
    sampling: np.ndarray
    model: Callable[[], np.ndarray] | None = None

    @property
    def in_space(self) -> np.ndarray:
        """The deflection in space [rad], shape (3,)."""
        return np.asarray(self.tilt @ self.axes)


def numbers_of(strehl: float, standard_error: float, rms: float, blocked: float, known: float) -> dict[str, float]:
    """Return the numbers of a direction, without their errors."""
    return {
        "strehl": strehl,
        "strehl_standard_error": standard_error,
        "opd_rms": rms,
        "blocked": blocked,
        "known": known,
    }


def few_of(looks: np.ndarray, rms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of a few directions, and for each direction which of these is the nearest, shape (n,).

    Args:
        looks: Unit vectors, shape (n, 3).
        rms: Their OPD rms [m], shape (n,).
    """
    level = np.log10(np.maximum(rms, WEAKEST * rms.max(initial=0.0) + 1e-300))
    place = np.column_stack([looks, level])
    rows = [int(np.argmax(rms))]
    apart = [np.linalg.norm(place - place[rows[0]], axis=1)]
    while len(rows) < FEW and np.min(apart, axis=0).max() > 0.0:
        rows.append(int(np.argmax(np.min(apart, axis=0))))
        apart.append(np.linalg.norm(place - place[rows[-1]], axis=1))
    return np.array(rows), np.argmin(apart, axis=0)


def tell_errors(found: list[Look], looks: np.ndarray) -> np.ndarray:
    """Add "strehl_error" and "opd_rms_error" to directions' numbers; return errors of their tilts.

    Returns:
        Vectors in space along both of each pupil's axes, of the errors' lengths [rad], shape (n, 2, 3).
    """
    rows = np.array([k for k, one in enumerate(found) if one.model is not None], int)
    model = np.zeros((len(found), len(found[0].sampling)))
    axes = np.stack([one.axes for one in found])
    along = axes.copy()
    if len(rows):
        few, nearest = few_of(looks[rows], np.array([found[k].numbers["opd_rms"] for k in rows]))
        computed = np.stack([found[k].model() for k in rows[few]])
        model[rows] = computed[nearest]
        along[rows] = axes[rows[few]][nearest]
    total = np.hypot(model, np.stack([one.sampling for one in found]))
    for one, error in zip(found, total, strict=True):
        one.numbers |= {"strehl_error": float(error[STREHL]), "opd_rms_error": float(error[RMS])}
    # Another direction's axes, as they lie across this one.
    normal = np.cross(axes[:, 0], axes[:, 1])
    along -= np.einsum("nak,nk->na", along, normal)[..., None] * normal[:, None]
    return np.asarray(along * total[:, TILT, None])
