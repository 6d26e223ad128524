"""Where the beam is sampled: quadrature points across it, each with the share of the beam's power that it stands for.

The points are those at which the undisturbed rays of the beam would cross the plane through the target's centre normal
to the axis (x and y of eq 8-12). A tensor product of Gauss-Legendre points spans the beam's support, cut at three
1/e^2 radii (4e-9 of the power lies outside), and the reflector's edges where those are nearer. With 20 points a side
or more the shares add up to the power within 1e-7.

A ray leaves the exit aperture at the homologous point: as far from the axis, in exit radii, as it arrives in radii at
the target. So an edge of a tilted reflector, seen by the diverging beam, lies at

    y = Y / (1 + q Y),  half width in x = X / (1 + q Y),  q = (1 - exit_radius / radius) tan(tilt) / distance

for a point (X, Y) of the reflector, Y the projection of its height on y.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..scene import Scene
from .checks import check_choice
from .radiometry import LIMITS

SUPPORT = 3.0  # [1/e^2 radii]
LEAST_SIDE = 20  # points a side


@dataclass(frozen=True)
class TargetPoints:
    """Rays of the beam.

    Attributes:
        aim: Where they would cross the plane normal to the axis at the target's centre [m], shape (m, 3).
        start: Where they leave the exit aperture [m], shape (m, 3).
        weight: Share of the beam's power, sums to what the reflector catches, shape (m,).
    """

    aim: np.ndarray
    start: np.ndarray
    weight: np.ndarray


def target_points(scene: Scene, limits: str = "beam") -> TargetPoints:
    """The rays of a scene's beam that its echo is summed over.

    Args:
        scene: The scene; `beam.ray_count` is rounded up to a square, at least 400.
        limits: "beam": the beam's support, or the reflector's edges where those are nearer; "paper": the whole beam
            in x and one radius either way in y (eq 11), whatever the reflector's size.

    Raises:
        ValueError: Unknown limits, or a target that reaches back to the aperture's plane.
    """
    check_choice(limits, "limits", LIMITS)
    beam, target, aperture_z = scene.beam, scene.target, scene.receiver.aperture_z
    side = max(math.ceil(math.sqrt(beam.ray_count)), LEAST_SIDE)
    node, weight = np.polynomial.legendre.leggauss(side)
    reach = SUPPORT * beam.radius
    if limits == "paper":
        y_low, y_high = -beam.radius, beam.radius
    else:
        divergence = (1.0 - beam.exit_radius / beam.radius) * math.tan(target.tilt) / target.distance
        edge = 0.5 * target.height * math.cos(target.tilt)
        if abs(divergence) * edge >= 1.0 or edge * abs(math.tan(target.tilt)) >= target.distance:
            raise ValueError(
                f"the target reaches back to the aperture: height {target.height:g} m at a tilt of {target.tilt:g} rad "
                f"and a distance of {target.distance:g} m; take a smaller tilt or height"
            )
        y_low, y_high = max(-edge / (1.0 - divergence * edge), -reach), min(edge / (1.0 + divergence * edge), reach)
    y = 0.5 * (y_high + y_low) + 0.5 * (y_high - y_low) * node
    y_weight = 0.5 * (y_high - y_low) * weight
    half_width = np.full(side, reach)
    if limits == "beam":
        # 1 + q Y in terms of y: Y = y / (1 - q y).
        half_width = np.minimum(0.5 * target.width * (1.0 - divergence * y), reach)
    x = half_width[:, None] * node
    density = 2.0 / (math.pi * beam.radius**2) * np.exp(-2.0 * (x**2 + y[:, None] ** 2) / beam.radius**2)
    share = density * y_weight[:, None] * half_width[:, None] * weight
    aim = np.stack([x, np.broadcast_to(y[:, None], x.shape), np.full(x.shape, aperture_z + target.distance)], axis=-1)
    start = aim * np.array([beam.exit_radius / beam.radius, beam.exit_radius / beam.radius, 0.0])
    start[..., 2] = aperture_z
    return TargetPoints(aim.reshape(-1, 3), start.reshape(-1, 3), share.ravel())
