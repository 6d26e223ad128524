r"""The linking equation: the variance of optical path differences from density statistics along the rays.

    <OPD'^2> = 2 K^2 \int <rho'^2> Lambda ds          Lambda(s) = \int_0 r(s, s + l) dl  to the first zero of r

(G. W. Sutton, AIAA J. 7 (1969) 1737). It takes the flow for homogeneous over a correlation length and the path for long
against it. Beside it stands the double integral K^2 \int \int <rho'(s) rho'(s')> ds ds' over the same samples, which
takes nothing for granted: their ratio is what the equation itself costs. Both are variances in time at a point of the
pupil, mean over the pupil and tilt of each map included.
"""

import math
from typing import Any

import numpy as np

from ..flow import GridMesh, Series, refractivity_model
from ..rays import as_unit_vector
from .line_integrals import LineIntegrals
from .modes import integral_length

RAYS = 49
BLOCKS = 10


def linking_equation(
    series: Series,
    points: np.ndarray,
    direction: Any,
    wavelength: float,
    *,
    relation: str = "gladstone-dale",
    constant: float | None = None,
) -> dict[str, tuple[float, float]]:
    """Both values, each with its standard error from parts of the series [m].

    Args:
        series: The snapshots, on one uniform grid.
        points: Where rays start [m], shape (n, 3); at most 49 of them, evenly chosen, are used.
        direction: Their direction, shape (3,).
        wavelength: Vacuum wavelength [m].
        relation: Density to index, linear ones only.
        constant: K [m3/kg].

    Returns:
        "opd_rms_linking" and "opd_rms_path", each (value, standard error).

    Raises:
        ValueError: Fewer than two snapshots, no uniform grid, or a relation that is not linear.
    """
    if not isinstance(series.mesh, GridMesh):
        raise ValueError("the linking equation needs a series on one uniform grid")
    if len(series) < 2:
        raise ValueError("the linking equation needs at least two snapshots")
    model = refractivity_model(relation, constant=constant)
    if model.form != "gladstone-dale":
        raise ValueError(f"relation {relation!r} is not linear in the density: take 'gladstone-dale'")
    chosen = points[np.unique(np.linspace(0, len(points) - 1, RAYS).round().astype(int))]
    lines = LineIntegrals(series.mesh, chosen, as_unit_vector(direction, "direction"), "linear")
    factor = float(model.constant(wavelength))
    densities = np.stack([lines.along(series.density(number)) for number in range(len(series))])
    weights = lines.path_weights()
    whole = _both(densities, weights, factor)
    blocks = min(BLOCKS, len(densities) // 2)
    parts = [_both(part, weights, factor) for part in np.array_split(densities, blocks)] if blocks >= 4 else []
    found = {}
    for k, name in enumerate(("opd_rms_linking", "opd_rms_path")):
        value = math.sqrt(max(whole[k], 0.0))
        spread = np.std([part[k] for part in parts], ddof=1) / math.sqrt(len(parts)) if parts else math.nan
        found[name] = (value, float(spread / (2.0 * value)) if value > 0.0 else math.nan)
    return found


def _both(densities: np.ndarray, weights: np.ndarray, factor: float) -> tuple[float, float]:
    """The two variances [m2], means over the rays, from densities (t, n, planes) and weights (n, planes) [m]."""
    count = len(densities)
    left = densities - densities.mean(axis=0)
    unbiased = count / (count - 1)
    linked, path = [], []
    for ray in range(left.shape[1]):
        covariance = unbiased * (left[:, ray].T @ left[:, ray]) / count
        step = weights[ray]
        path.append(step @ covariance @ step)
        pitch = float(step.max())
        scales = []
        for plane in range(len(step)):
            ahead, behind = covariance[plane, plane:], covariance[plane, plane::-1]
            lengths = [integral_length(side, pitch) for side in (ahead, behind) if len(side) > 1]
            # Toward an end that is nearer than the correlation reaches, the other side stands for both.
            scales.append(np.nanmax(lengths) if np.isfinite(lengths).any() else 0.0)
        linked.append(2.0 * (step * np.diag(covariance)) @ np.array(scales))
    return factor**2 * float(np.mean(linked)), factor**2 * float(np.mean(path))
