"""Exact rays past a sharp cone: Snell's law at its shock, DOP853 through the Taylor-Maccoll flow behind it.

The index is ambient + (ambient - 1) (density ratio - 1) by Gladstone-Dale, a function of the polar angle alone behind
the shock. With the momentum T = n dr/ds and ds = n dt: r' = T, T' = n grad n. Across the shock the tangential momentum
is conserved.
"""

import numpy as np

from aerokernels.flow.taylor_maccoll import ConeShock
from aerokernels.rays import RayBundle

# Difference of the polar angle [rad] for the slope of the density ratio.
ANGLE_STEP = 1e-6
TOLERANCE = 1e-8


def rays_past_cone(shock: ConeShock, ambient: float, rays: RayBundle) -> tuple[np.ndarray, np.ndarray]:
    """Return where rays have left the flow over a cone (tip at the origin, body along -z), and their directions there.

    Rays start outside the shock and meet neither body nor base; a ray that misses the shock is returned unchanged.

    Returns:
        Points [m] and unit directions, both of shape (ray_count, 3).
    """
    position, direction = np.array(rays.position), np.array(rays.direction)
    for place, way in zip(position, direction, strict=True):
        distance = _first_meeting(place, way, np.tan(shock.shock_angle))
        if distance is not None:
            place += distance * way
            place[:], way[:] = _through(shock, ambient, place.copy(), way.copy())
    return position, direction


def _first_meeting(place: np.ndarray, way: np.ndarray, slope: float) -> float | None:
    """Distance to the shock cone along a line from outside [m]; None where it misses."""
    scale = np.array([1.0, 1.0, -(slope**2)])
    a, b, c = (float(scale @ one) for one in (way**2, way * place, place**2))
    inside = b**2 - a * c
    if inside <= 0.0:
        return None
    roots = [(-b + sign * np.sqrt(inside)) / a for sign in (-1.0, 1.0)]
    ahead = [root for root in roots if root > 0.0 and place[2] + root * way[2] < 0.0]
    return min(ahead) if ahead else None


def _through(shock: ConeShock, ambient: float, place: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Trace from a point on the shock through the flow to the other side of the shock."""
    from scipy.integrate import solve_ivp

    edge = shock.shock_angle

    def index(angle: float) -> float:
        return ambient + (ambient - 1.0) * (float(shock.density_ratio_at(min(angle, edge))) - 1.0)

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        radius = float(np.hypot(state[0], state[1]))
        angle, square = float(np.arctan2(radius, -state[2])), radius**2 + state[2] ** 2
        low, high = min(angle, edge) - ANGLE_STEP, min(angle + ANGLE_STEP, edge)
        slope = (index(high) - index(low)) / (high - low) if angle < edge + ANGLE_STEP else 0.0
        across = -state[2] / square / radius
        gradient = slope * np.array([across * state[0], across * state[1], radius / square])
        return np.concatenate([state[3:], index(angle) * gradient])

    def leaves(_: float, state: np.ndarray) -> float:
        return float(np.arctan2(np.hypot(state[0], state[1]), -state[2])) - edge

    leaves.terminal, leaves.direction = True, 1.0  # type: ignore[attr-defined]
    momentum = _refracted(ambient * way, _normal(place, edge), index(edge))
    # Start slightly inside, so that the shock at the start is not detected as an event.
    begin = place + 1e-9 * momentum
    found = solve_ivp(
        rate,
        (0.0, 10.0 * float(np.linalg.norm(place))),
        np.concatenate([begin, momentum]),
        method="DOP853",
        rtol=TOLERANCE,
        atol=TOLERANCE * np.repeat([1e-3, 1e-2], 3),
        events=leaves,
    )
    state = found.y[:, -1]
    out = _refracted(state[3:], _normal(state[:3], edge), ambient)
    return state[:3], out / np.linalg.norm(out)


def _normal(place: np.ndarray, edge: float) -> np.ndarray:
    """Outward unit normal of the shock at a point on it."""
    radius = np.hypot(place[0], place[1])
    normal = np.array([place[0] / radius, place[1] / radius, np.tan(edge)])
    return np.asarray(normal / np.linalg.norm(normal))


def _refracted(momentum: np.ndarray, normal: np.ndarray, index: float) -> np.ndarray:
    """The momentum behind a surface beyond which the index is `index`."""
    through = float(momentum @ normal)
    along = momentum - through * normal
    return np.asarray(along + np.sign(through) * np.sqrt(index**2 - along @ along) * normal)
