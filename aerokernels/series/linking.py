r"""The linking equation: the variance of optical path differences from density statistics along the rays.

    <OPD'^2> = 2 K^2 \int <rho'^2> Lambda ds          Lambda(s) = \int_0 r(s, s + l) dl  to the first zero of r

(G. W. Sutton, AIAA J. 7 (1969) 1737). It assumes that the flow is homogeneous over a correlation length and that the
path is long against it. The double integral K^2 \int \int <rho'(s) rho'(s')> ds ds' over the same samples, which is
computed as well, makes no such assumption: the ratio of the two is the error of the equation itself. Both are variances
in time at a point of the pupil, with the mean over the pupil and the tilt of each map included.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..device_arrays import host_array
from ..flow import DensityField, GridMesh, Series, refractivity_model
from ..pupils.base import as_unit_vector
from .line_integrals import LineIntegrals
from .modes import first_zero_weights, integral_length
from .uncertainty import Mean, about_mean_of, root_of, standard_errors

RAYS = 49
# Greatest difference between times of one snapshot, over the step between snapshots.
SAME_TIME = 0.01


class NotLinkedError(ValueError):
    """The linking equation does not hold for a series."""


def linking_equation(
    series: Series,
    points: np.ndarray,
    direction: Any,
    wavelength: float,
    *,
    relation: str | None = None,
    constant: float | None = None,
    snapshots: Sequence[int] | None = None,
) -> dict[str, Mean]:
    """Return both values [m], each with its standard error.

    Args:
        series: The snapshots, on one uniform grid.
        points: Starting points of rays [m], shape (n, 3); at most 49 of them, evenly chosen, are used.
        direction: Their direction, shape (3,).
        wavelength: Vacuum wavelength [m].
        relation: Density to index, linear ones only; None as for `flow.refractivity_model`.
        constant: K [m3/kg].
        snapshots: Numbers of the snapshots to take; None takes all.

    Returns:
        "opd_rms_linking" and "opd_rms_path" [m].

    Raises:
        NotLinkedError: Fewer than two snapshots, snapshots on several grids or of several gases, or a relation that is
            not linear.
    """
    if not isinstance(series.mesh, GridMesh):
        raise NotLinkedError("the linking equation needs a series on one uniform grid")
    numbers = range(len(series)) if snapshots is None else snapshots
    if len(numbers) < 2:
        raise NotLinkedError("the linking equation needs at least two snapshots")
    model = refractivity_model(relation, constant=constant)
    if model.form != "gladstone-dale":
        raise NotLinkedError(f"relation {model.name!r} is not linear in the density: take 'gladstone-dale'")
    chosen = points[np.unique(np.linspace(0, len(points) - 1, RAYS).round().astype(int))]
    lines = LineIntegrals(series.mesh, chosen, as_unit_vector(direction, "direction"), "linear")
    factor = float(model.constant(wavelength))
    densities = np.stack([lines.along(_on_grid(series, number)) for number in numbers])
    weights = lines.path_weights()
    names = "opd_rms_linking", "opd_rms_path"
    squares = factor**2 * _linked_and_path(densities, weights)
    independent = float(standard_errors(np.einsum("tnp,np->tn", densities, weights))[1].mean())
    return {name: root_of(about_mean_of(one, independent)) for name, one in zip(names, squares, strict=True)}


def snapshots_at(series: Series, times: np.ndarray) -> list[int]:
    """Return the numbers of a series' snapshots at the times of maps [s], which may be a part of them.

    Raises:
        NotLinkedError: The series has no snapshot at one of these times, or one of them is NaN.
    """
    if len(times) == len(series):  # dates are known from the first of them on only
        return list(range(len(series)))
    known = np.asarray(series.time, dtype=np.float64)
    nearest = np.abs(times[:, None] - known).argmin(axis=1)
    step = np.diff(np.sort(known)).min() if len(known) > 1 else 0.0
    apart = np.abs(known[nearest] - times)
    same = apart <= SAME_TIME * step + 1e-12 * np.abs(times)
    if not same.all():
        time = times[int(np.argmin(same))]
        raise NotLinkedError(
            f"the linking equation needs the series of the maps: it has no snapshot at {time:g} s, as the maps have; "
            "keep the times of optical_series, in seconds"
        )
    return nearest.tolist()


def _on_grid(series: Series, number: int) -> np.ndarray:
    """Return the densities of a snapshot [kg/m3] on the grid of the series."""
    found = series.read(number)
    if not isinstance(found, DensityField):
        return host_array(found)
    if not series.lies_here(found):
        raise NotLinkedError(
            f"the linking equation needs all snapshots on one uniform grid: snapshot {number} is elsewhere"
        )
    if getattr(found, "composition", None) is not None:
        raise NotLinkedError(f"the linking equation needs one gas: snapshot {number} is a mixture with a K of its own")
    return np.asarray(found.density)  # type: ignore[attr-defined]


def _linked_and_path(densities: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the contribution of each snapshot to the two variances over K^2 [kg2/m4], means over rays, shape (2, t).

    The variances are those about the mean of the snapshots, which is not corrected for.

    Args:
        densities: Along the rays [kg/m3], shape (t, n, planes).
        weights: The length of each ray that each plane represents [m], shape (n, planes).
    """
    left = densities - densities.mean(axis=0)
    found = np.zeros((2, len(densities)))
    for along, step in zip(np.moveaxis(left, 1, 0), weights, strict=True):
        covariance = along.T @ along  # of any scale: its shape alone counts below
        pitch = float(step.max())
        scale = np.zeros(covariance.shape)
        for plane, row in enumerate(covariance):
            # If one end is nearer than the correlation length, the other side is used for both.
            sides = [side for side in (slice(plane, None), slice(plane, None, -1)) if len(row[side]) > 1]
            lengths = [integral_length(row[side], pitch) for side in sides]
            if np.isfinite(lengths).any():
                side = sides[int(np.nanargmax(lengths))]
                scale[plane, side] = 2.0 * step[plane] * first_zero_weights(row[side], pitch)
        found += [np.sum(along @ scale * along, axis=1), (along @ step) ** 2]
    return found / len(weights)
