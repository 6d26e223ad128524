r"""The oracle: one ray at a time in float64, written to be read, sharing no formula with the kernels.

State (r, T, optical path, arc length, lag) over sigma, d sigma = ds / n:

    r' = T,   T' = n grad n,   path' = n^2,   arc' = n

"adaptive" is SciPy's DOP853 at a relative tolerance of 1e-11 whatever was asked for, stops found as events; "straight"
is the same with the lookups on the undisturbed line. "fixed" and "paper" take the steps of their rule with the pair of
tableau.py, the momentum brought back to |T| = n after each, the last one shortened by Brent's method until it ends on
the stop.
"""

import time

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ..medium import IndexField
from ..rays import RayBundle
from .plan import TracePlan
from .result import RAY_OUTPUTS
from .scheme import WALL_MARCH_LIMIT
from .status import RayStatus
from .stop import ArcLength, Plane
from .tableau import BT, NEARLY_STRAIGHT, STAGE_MOMENTUM, A, C, is_one_scalar

RELATIVE_TOLERANCE = 1e-11


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset):
    """Trace every ray: per-ray arrays by name, and seconds."""
    start = time.perf_counter()
    rows = [_Ray(field, p, d, until, plan).run() for p, d in zip(rays.position, rays.direction, strict=True)]
    arrays = {
        name: np.array([row[name] for row in rows]) for name in [*RAY_OUTPUTS, "status"] if name in outputs | {"status"}
    }
    spent = time.perf_counter() - start
    return arrays, {"compile": 0.0, "upload": 0.0, "kernel": spent, "download": 0.0}


def box_span(low, high, position, direction) -> tuple[np.ndarray, np.ndarray]:
    """Where straight rays enter and leave a box (entry at least 0) [m]; entry >= exit means a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (low - position) / direction, (high - position) / direction
    parallel = direction == 0.0
    outside = parallel & ((position < low) | (position > high))
    near = np.where(parallel, -np.inf, near)
    far = np.where(parallel, np.inf, far)
    enter = np.maximum(np.minimum(near, far).max(axis=1), 0.0)
    leave = np.maximum(near, far).min(axis=1)
    return enter, np.where(outside.any(axis=1), -np.inf, leave)


class _Ray:
    """One ray through one field to one stop."""

    def __init__(self, field: IndexField, position, direction, until, plan: TracePlan):
        self.field, self.until, self.plan = field, until, plan
        self.start, self.heading = np.array(position), np.array(direction)
        self.ambient = field.ambient_index
        self.low, self.high = field.box
        self.evaluations = 0
        self.steps = 0
        self.bent = 0.0  # greatest angle with the first direction

    def span(self) -> tuple[float, float]:
        """Where the undisturbed ray enters and leaves the box [m]."""
        low, high = self.low.copy(), self.high.copy()
        if self.field.geometry != "axisymmetric":
            enter, leave = box_span(low, high, self.start[None], self.heading[None])
            return float(enter[0]), float(leave[0])
        low[:2], high[:2] = -np.inf, np.inf
        (enter,), (leave,) = box_span(low, high, self.start[None], self.heading[None])
        across, place, radius = self.heading[:2], self.start[:2], self.high[0]
        square = across @ across
        if square == 0.0:
            return (enter, leave) if place @ place <= radius**2 else (0.0, -np.inf)
        middle = -(place @ across) / square
        rest = radius**2 - np.sum((place + middle * across) ** 2)
        if rest < 0.0:
            return 0.0, -np.inf
        half = np.sqrt(rest / square)
        return max(enter, middle - half, 0.0), min(leave, middle + half)

    def outside(self, r: np.ndarray) -> float:
        """How far outside the box a point is [m]; negative inside."""
        if self.field.geometry == "axisymmetric":
            return max(np.hypot(r[0], r[1]) - self.high[0], r[2] - self.high[2], self.low[2] - r[2])
        return float(np.max(np.maximum(r - self.high, self.low - r)))

    def in_body(self, r: np.ndarray) -> float:
        """Signed distance to the body [m], negative inside."""
        return float(self.field.wall_distance.evaluate(self.field.local_coordinates(r))[0])

    def undisturbed(self) -> float | None:
        """Distance to the stop along the undisturbed ray [m], None if it never gets there."""
        if isinstance(self.until, Plane):
            height = (self.start - self.until.point) @ self.until.normal
            slope = self.heading @ self.until.normal
            if height == 0.0:
                return 0.0
            return -height / slope if height * slope < 0.0 else None
        if isinstance(self.until, ArcLength):
            return self.until.length
        return self.span()[1]

    def look(self, r: np.ndarray) -> tuple[float, np.ndarray]:
        """Index and its gradient; the field goes on smoothly a little beyond its box for stages that leave it."""
        self.evaluations += 1
        local = self.field.local_coordinates(r)
        low, high = self.field.samples.low, self.field.samples.high
        inside = np.clip(local, low, high)
        if self.field.geometry == "volume":
            point = inside[0]
        elif self.field.geometry == "planar":
            point = np.array([r[0], *inside[0]])
        else:
            scale = inside[0, 0] / local[0, 0] if local[0, 0] > 0.0 else 1.0
            point = np.array([r[0] * scale, r[1] * scale, inside[0, 1]])
        contrast, gradient = self.field.evaluate(point)
        return self.ambient + contrast[0] + gradient[0] @ (r - point), gradient[0]

    def run(self) -> dict:
        """Trace the ray."""
        enter, leave = self.span()
        stop_at = self.undisturbed()
        meets = leave >= enter
        if not meets and self.until is None:
            return self.result(self.start, self.heading, 0.0, 0.0, RayStatus.MISSED_FIELD, 0.0)
        if self.until is not None and stop_at is not None and stop_at <= enter:
            meets = False
        if meets and self.field.body is not None:
            out = self.leave_body(enter, leave)
            if out is None:
                return self.result(self.start, self.heading, 0.0, 0.0, RayStatus.INSIDE_BODY, None)
            enter = out
            if self.until is not None and stop_at is not None and stop_at <= enter:
                meets = False
        if not meets:
            return self.fly(self.start, self.heading, 0.0, 0.0, stop_at)
        r = self.start + enter * self.heading
        index, _ = self.look(r)
        state = np.array([*r, *(index * self.heading), self.ambient * enter, enter, 0.0])
        origin = r
        march = self.by_rule if self.plan.method in ("fixed", "paper") else self.by_dop853
        state, status, at_stop = march(state)
        if march == self.by_rule and is_one_scalar(self.field.interpolation) and self.bent <= NEARLY_STRAIGHT:
            # Along the first direction the deviation is the arc less the lag: better known than the steps' own.
            slip = state[7] - enter - state[8] - (state[:3] - origin) @ self.heading
            if at_stop and isinstance(self.until, ArcLength):
                state[:3] += slip * self.heading
            else:  # the ray ends on a surface: its place is right, its length is not
                state[6] -= self.ambient * slip
                state[7] -= slip
        heading = state[3:6] / np.linalg.norm(state[3:6])
        if status != RayStatus.OK or at_stop or self.until is None:
            return self.result(state[:3], heading, state[6], state[7], status, stop_at)
        return self.fly(state[:3], heading, state[6], state[7], stop_at)

    def leave_body(self, enter: float, leave: float) -> float | None:
        """Distance at which the straight ray is out of the body, or at its stop within; None if it never is."""

        def outside_by(along: float) -> float:
            return self.in_body(self.start + along * self.heading)

        at, apart = enter, outside_by(enter)
        least = 0.25 * float(self.field.wall_distance.spacing.min())
        for _ in range(WALL_MARCH_LIMIT):
            if apart >= 0.0 or at > leave:
                break
            step = max(-apart, least)  # as far as the wall is away at least
            apart = outside_by(at + step)
            if apart >= 0.0:
                return brentq(outside_by, at, at + step, xtol=1e-15)
            at += step
        return at if apart >= 0.0 or self.stops_before(at) else None

    def stops_before(self, along: float) -> bool:
        """Whether the undisturbed ray has a stop no further than this."""
        stop_at = self.undisturbed()
        return self.until is not None and stop_at is not None and stop_at <= along

    def fly(self, r, heading, path, arc, stop_at) -> dict:
        """Free flight to a stop outside the box."""
        if isinstance(self.until, ArcLength):
            rest = self.until.length - arc
        else:
            height = (r - self.until.point) @ self.until.normal
            slope = heading @ self.until.normal
            # A plane on a face of the box: the event may have put the ray a hair behind it.
            hair = 1e-3 * float(np.min(self.field.spacing))
            at_plane = r is not self.start and abs(height) < hair * abs(slope)
            if height != 0.0 and height * slope >= 0.0 and not at_plane:
                return self.result(r, heading, path, arc, RayStatus.STOP_NOT_REACHED, None)
            rest = -height / slope if height != 0.0 else 0.0
        return self.result(r + rest * heading, heading, path + self.ambient * rest, arc + rest, RayStatus.OK, stop_at)

    def result(self, r, heading, path, arc, status, stop_at) -> dict:
        """The row of one ray."""
        if isinstance(self.until, ArcLength) or stop_at is None or status != RayStatus.OK:
            stop_at = arc
        return {
            "position": r,
            "direction": heading,
            "optical_path": path,
            "opd": path - self.ambient * stop_at,
            "arc_length": arc,
            "step_error": 0.0,
            "step_count": self.steps,
            "evaluation_count": self.evaluations,
            "status": int(status),
        }

    def stop_value(self, state: np.ndarray) -> float:
        """Negative before the user's stop, positive behind it."""
        if isinstance(self.until, Plane):
            side = np.sign((self.start - self.until.point) @ self.until.normal)
            return -side * float((state[:3] - self.until.point) @ self.until.normal)
        if isinstance(self.until, ArcLength):
            return state[7] - self.until.length
        return -1.0

    def by_dop853(self, state):
        """Adaptive integration by SciPy; along the undisturbed line if the method is "straight"."""
        origin, heading = state[:3].copy(), self.heading
        straight = self.plan.method == "straight"

        def rate(sigma, y):
            if straight:
                line = origin + heading * (self.ambient * sigma)
                index, gradient = self.look(line)
                potential = 0.5 * (index**2 - self.ambient**2) + index * gradient @ (y[:3] - line)
                local = np.sqrt(self.ambient**2 + 2.0 * potential)
                return [*y[3:6], *(index * gradient), local**2, local, 0.0]
            index, gradient = self.look(y[:3])
            return [*y[3:6], *(index * gradient), index**2, index, 0.0]

        def leaves(sigma, y):
            return self.outside(origin + heading * (self.ambient * sigma) if straight else y[:3])

        def arrives(sigma, y):
            return self.stop_value(y)

        def hits(sigma, y):
            return 1.0 if self.field.body is None else self.in_body(y[:3]) + 1e-9

        for event, sense in ((leaves, 1.0), (arrives, 1.0), (hits, -1.0)):
            event.terminal, event.direction = True, sense  # type: ignore[attr-defined]
        diagonal = float(np.linalg.norm(np.where(np.isfinite(self.high - self.low), self.high - self.low, 0.0)))
        limit = 1e4 * diagonal / self.ambient
        # Half a cell: over the knots of a spline a long step's own estimate of its error is not to be believed.
        reach = 0.5 * float(np.min(self.field.spacing))
        if self.field.body is not None:
            reach = min(reach, float(self.field.wall_distance.spacing.min()))
        solution = solve_ivp(
            rate,
            (0.0, limit),
            state,
            method="DOP853",
            rtol=RELATIVE_TOLERANCE,
            atol=1e-15 + 1e-12 * diagonal,
            events=[leaves, arrives, hits],
            max_step=reach / self.ambient,
        )
        self.steps = len(solution.t) - 1
        for k, status in ((2, RayStatus.HIT_BODY), (1, RayStatus.OK), (0, RayStatus.OK)):
            if len(solution.t_events[k]):
                return solution.y_events[k][-1], status, k == 1
        status = RayStatus.MAX_STEPS if solution.success else RayStatus.NOT_FINITE
        return solution.y[:, -1], status, False

    def by_rule(self, state):
        """Steps of the rule "fixed" or "paper"."""
        while self.steps < self.plan.max_steps:
            index, gradient = self.look(state[:3])
            length = self.plan.step or self.paper_step(state[:3])
            h = length / index
            after = self.nystrom(state, index, gradient, h)
            self.steps += 1
            if self.field.body is not None and self.in_body(after[:3]) < 0.0:
                return after, RayStatus.HIT_BODY, False
            ends = [
                (self._landing(state, index, gradient, h, value), k)
                for k, value in ((1, self.stop_value), (0, lambda y: self.outside(y[:3])))
                if value(after) > 0.0
            ]
            if ends:
                h, k = min(ends)
                return self.nystrom(state, index, gradient, h), RayStatus.OK, k == 1
            state = after
        return state, RayStatus.MAX_STEPS, False

    def _landing(self, state, index, gradient, h, value) -> float:
        def end(length):
            return value(self.nystrom(state, index, gradient, length))

        # A step from the face by which the ray came in starts on the surface: look from just behind it.
        first = 0.0 if value(state) < 0.0 else 1e-6 * h
        return brentq(end, first, h, xtol=1e-16, rtol=1e-15) if end(first) < 0.0 else 0.0

    def paper_step(self, r: np.ndarray) -> float:
        """Step of eq 5 in the cell that holds a point [m]."""
        samples, local = self.field.samples, self.field.local_coordinates(r)
        if not self.field.is_uniform:
            cell = int(samples.mesh.locate(local)[0])
            return float(samples.paper_step[cell] if cell >= 0 else np.median(samples.paper_step))
        place = np.floor((local[0] - samples.origin) / samples.spacing).astype(int)
        return float(samples.paper_step[tuple(np.clip(place, 0, np.array(samples.shape) - 2))])

    def nystrom(self, state, index, gradient, h) -> np.ndarray:
        """One step of the fourth-order formula."""
        r, momentum = state[:3], state[3:6]
        indices, forces = [index], [index * gradient]
        for stage in range(1, 4):
            kick = sum(a * f for a, f in zip(A[stage], forces, strict=False))
            here, slope = self.look(r + C[stage] * h * momentum + h * h * kick)
            indices.append(here)
            forces.append(here * slope)
        result = state.copy()
        result[:3] = r + h * momentum + h * h * sum(a * f for a, f in zip(A[3], forces, strict=False))
        result[3:6] = momentum + h * sum(b * f for b, f in zip(BT, forces, strict=True))
        result[6] += h * sum(b * n * n for b, n in zip(BT, indices, strict=True))
        result[7] += h * sum(b * n for b, n in zip(BT, indices, strict=True))
        if is_one_scalar(self.field.interpolation):
            result[3:6] *= indices[-1] / np.linalg.norm(result[3:6])
            swung = momentum + h * forces[-1]
            across = swung - (swung @ self.heading) * self.heading
            self.bent = max(self.bent, float(np.linalg.norm(across)) / self.ambient)
            result[8] += h * sum(
                b * self.lag(momentum + h * sum(w * f for w, f in zip(row, forces, strict=True)), n)
                for b, row, n in zip(BT, STAGE_MOMENTUM, indices, strict=True)
            )
        return result

    def lag(self, momentum: np.ndarray, index: float) -> float:
        """Index less the momentum along the first direction."""
        ahead = momentum @ self.heading
        across = momentum - ahead * self.heading
        return float(across @ across / (index + ahead)) if index + ahead > 0.0 else 0.0
