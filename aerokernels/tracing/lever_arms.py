"""Lever arms: how far rays fly, and how an error of their direction changes their optical path.

Where a ray meets its stop at an angle to the normal, an error of its direction becomes an error of its optical path: it
is multiplied by the distance from the error to the stop and by the tangent of that angle. This product is the lever
arm. Air that is left out of a trace must be judged by it as well, not by its own optical path alone (support.py).
"""

from dataclasses import dataclass

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..rays import RayBundle
from .lines import BOXES, crossing_of_box
from .scheme import LEAST_COSINE
from .stop import ArcLength, Plane


@dataclass(frozen=True)
class LeverArms:
    """The greatest lengths over a bundle of undisturbed rays [m].

    Attributes:
        path_length: Path through the field's box, up to the stop if that lies in it.
        reach: Distance from where a ray enters the box to its stop.
        lever_arm: That distance times the tangent of the angle between the ray and the stop's normal, of rays that do
            not graze the stop (LEAST_COSINE).
    """

    path_length: float
    reach: float
    lever_arm: float


def lever_arms_of(field: IndexField, rays: RayBundle, until) -> LeverArms | None:
    """The lever arms of a bundle up to its stop; None where no ray meets the field's box before it.

    Args:
        field: The refractive index.
        rays: The rays, undisturbed.
        until: None (the end of the box), a Plane or an ArcLength.
    """
    low, high = (np.asarray(corner, dtype=float)[0 if field.geometry == "volume" else 1 :] for corner in field.box)
    return _lever_arms(rays, field.geometry, low, high, until)


@cached_on("rays", BOXES)
def _lever_arms(rays: RayBundle, geometry: str, low: np.ndarray, high: np.ndarray, until) -> LeverArms | None:
    enter, leave, cosine = crossing_of_box(rays.position, rays.direction, low, high, geometry)
    stop = leave
    if isinstance(until, Plane):
        cosine = rays.direction @ until.normal
        height = (until.point - rays.position) @ until.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            stop = np.where(height * cosine > 0.0, height / cosine, np.inf)
    elif isinstance(until, ArcLength):
        cosine, stop = np.ones(len(leave)), np.full(len(leave), until.length)
    leave = np.minimum(leave, stop)
    good = (leave > enter) & np.isfinite(leave)
    if not good.any():
        return None
    reach = np.where(np.isfinite(stop), stop, leave)[good] - enter[good]
    steep = np.abs(cosine[good])
    tangent = np.sqrt(np.maximum(1.0 - steep**2, 0.0)) / np.maximum(steep, LEAST_COSINE)
    lever_arm = np.where((steep > LEAST_COSINE) & np.isfinite(stop[good]), reach * tangent, 0.0)
    return LeverArms(float((leave - enter)[good].max()), float(reach.max()), float(lever_arm.max()))


def obliquity(direction: np.ndarray, until) -> np.ndarray:
    """Return the vector o for which a displacement x of a ray changes its path length to the stop by x . o.

    The vector is perpendicular to the ray. Its length is the tangent of the angle between the ray and the stop's
    normal, at most the tangent for rays that graze the stop (LEAST_COSINE).

    Args:
        direction: Unit vectors, shape (n, 3).
        until: The stop. Only a Plane can be oblique.

    Returns:
        Shape (n, 3).
    """
    if not isinstance(until, Plane):
        return np.zeros_like(direction)
    cosine = (direction @ until.normal)[:, None]
    steep = np.copysign(np.maximum(np.abs(cosine), LEAST_COSINE), cosine)
    return np.asarray((cosine * direction - until.normal) / steep)
