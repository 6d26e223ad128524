"""Model how a surface reflects: Lambertian, or a diffuse part and a lobe about the mirror direction (modified Phong).

    f_r = rho / pi                                                     Lambertian
    f_r = rho [(1 - s) / pi + s (n + 2) / (2 pi) cos(alpha)^n]         Phong, 0 for the lobe where cos(alpha) < 0

rho is the reflectivity, s the lobe's fraction, n its exponent, alpha the angle between the mirror direction of the
incident light and the direction to the receiver. For a receiver beside the laser alpha is twice the incidence. The lobe
is normalised: it returns s rho of the light at normal incidence and less at other incidences, so it creates no light
(E. Lafortune, Y. Willems, Using the modified Phong reflectance model for physically based rendering, K. U. Leuven
CW197, 1994).
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive, check_share

if TYPE_CHECKING:
    from ..scene import Scene


@checked
@dataclass(frozen=True)
class Reflector:
    """A surface's reflectance; Lambertian unless `specular_share` is positive.

    Attributes:
        reflectivity: Fraction of the light reflected at normal incidence, 0 to 1.
        specular_share: Fraction of the reflected light in the lobe, 0 to 1.
        specular_exponent: The lobe's exponent, positive.

    Raises:
        ValueError: A number out of range.
    """

    reflectivity: float
    specular_share: float = 0.0
    specular_exponent: float = 20.0

    def __post_init__(self):
        """Check the numbers."""
        check_share(self.reflectivity, "reflectivity")
        check_share(self.specular_share, "specular_share")
        check_positive(self.specular_exponent, "specular_exponent")

    @checked
    def reflectance(self, lobe_cosine: Numbers) -> np.ndarray:
        """Return f_r [1/sr], of the shape of `lobe_cosine`, the cosine of alpha."""
        lobe = np.maximum(np.asarray(lobe_cosine, dtype=np.float64), 0.0) ** self.specular_exponent
        diffuse = (1.0 - self.specular_share) / math.pi
        peak = self.specular_share * (self.specular_exponent + 2.0) / (2.0 * math.pi)
        return np.asarray(self.reflectivity * (diffuse + peak * lobe))


def reflector_of(scene: "Scene") -> Reflector:
    """Return the reflector of a scene."""
    target = scene.target
    share = target.specular_share if target.reflector == "phong" else 0.0
    return Reflector(target.reflectivity, share, target.specular_exponent)


def lobe_cosine(direction: np.ndarray, normal: np.ndarray, to_receiver: np.ndarray) -> np.ndarray:
    """Cosine of the angle between the mirror direction and the direction to the receiver.

    Args:
        direction: Unit vectors along the incident light, shape (m, 3).
        normal: Unit normal of the surface, either side, shape (3,).
        to_receiver: Unit vectors from the surface to the receiver, shape (m, 3).

    Returns:
        The cosine, shape (m,).
    """
    mirrored = direction - 2.0 * (direction @ normal)[:, None] * normal
    return np.sum(mirrored * to_receiver, axis=1)
