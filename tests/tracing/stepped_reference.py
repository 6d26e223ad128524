"""The methods "fixed" and "paper" in NumPy, to compare kernels with: the same steps, without formulas of the kernels.

The state (r, T, optical path, arc length) is not in deviation form. If index and gradient come from the same
interpolant, the momentum is projected back to |T| = n after each step. The last step is shortened by bisection until it
ends on the stop or on a face of the box. `lag` sums the index minus the momentum along the first direction, which gives
the deviation along that direction more accurately than the positions do.
"""

from types import SimpleNamespace

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.engines.reference.ends import Ends
from aerokernels.tracing.engines.reference.flight import Flight, starting_momentum
from aerokernels.tracing.engines.reference.medium import GridAir, dot
from aerokernels.tracing.engines.reference.mesh import MeshAir
from aerokernels.tracing.stop import RayStatus, reached
from aerokernels.tracing.tableau import BT, NEARLY_STRAIGHT, STAGE_MOMENTUM, A, C, has_consistent_gradient

BISECTIONS = 60
# Columns of the state: position, momentum, optical path, arc length, lag.
PATH, ARC, LAG = 6, 7, 8


def trace_in_steps(field: IndexField, rays: RayBundle, *, step: float | None = None, until=None) -> SimpleNamespace:
    """Trace rays in steps of a length of arc [m], or of eq 5 without one; the arrays of a TraceResult, and `ok`."""
    start, heading = np.array(rays.position), np.array(rays.direction)
    ends = Ends(field, until)
    interval = ends.interval(start, heading)
    rows = np.flatnonzero(interval.meets & (interval.status == RayStatus.OK))
    air = GridAir(field) if field.is_uniform else MeshAir(field)
    some = type(interval)(*(getattr(interval, name)[rows] for name in interval.__dataclass_fields__))
    entry = start[rows] + some.t_enter[:, None] * heading[rows]
    flight = ends.flight(start[rows], heading[rows], some, air.cell_at(entry, heading[rows]))
    turn = march(field, ends, flight, step)
    found = ends.finish(interval, rows, flight, turn, start, heading, False)
    return SimpleNamespace(**found, ok=reached(found["status"]))


def march(field: IndexField, ends: Ends, flight: Flight, step: float | None) -> np.ndarray:
    """Take a flight to its end; return its tangents minus the first directions, shape (n, 3)."""
    rule = _Rule(field, ends, flight, step)
    rule.run()
    state, enter = rule.state, rule.enter
    ambient, heading = field.ambient_index, flight.direction
    along = state[:, ARC].copy()
    if rule.consistent_gradient:
        # Along the first direction the deviation is the arc minus the lag.
        slip = state[:, ARC] - enter - state[:, LAG] - dot(state[:, :3] - rule.origin, heading)
        slip = np.where(rule.deflection <= NEARLY_STRAIGHT, slip, 0.0)
        by_arc = flight.stopped & isinstance(ends.until, ArcLength)
        state[by_arc, :3] += slip[by_arc, None] * heading[by_arc]
        slip = np.where(by_arc, 0.0, slip)  # at other stops the position is right, and the length is corrected
        state[:, PATH] -= ambient * slip
        along = along - slip
    turn = state[:, 3:6] / np.linalg.norm(state[:, 3:6], axis=1)[:, None] - heading
    flight.along[:] = along
    flight.work[:] = state[:, PATH] - ambient * along
    flight.q[:] = state[:, :3] - flight.start - along[:, None] * heading
    return turn


class _Rule:
    def __init__(self, field, ends, flight, step):
        self.field, self.ends, self.flight, self.step = field, ends, flight, step
        self.ambient, self.until = field.ambient_index, ends.until
        self.consistent_gradient = has_consistent_gradient(field.interpolation)
        self.enter = flight.along.copy()
        self.origin = flight.start + self.enter[:, None] * flight.direction
        count = len(self.origin)
        self.deflection = np.zeros(count)  # greatest angle with the first direction
        index, _ = self.look(self.origin)
        turned = starting_momentum(self.ambient, index - self.ambient, flight.direction, flight.normal)
        start = [self.origin, self.ambient * flight.direction + turned]
        self.state = np.concatenate([*start, (self.ambient * self.enter)[:, None], self.enter[:, None]], axis=1)
        self.state = np.concatenate([self.state, np.zeros((count, 1))], axis=1)

    def look(self, place) -> tuple[np.ndarray, np.ndarray]:
        """Index and its gradient; for stages beyond the box the field is extrapolated linearly."""
        field = self.field
        local = field.local_coordinates(place)
        inside = np.clip(local, field.samples.low, field.samples.high)
        if field.geometry == "volume":
            point = inside
        elif field.geometry == "planar":
            point = np.concatenate([place[:, :1], inside], axis=1)
        else:
            scale = np.where(local[:, 0] > 0.0, inside[:, 0] / np.where(local[:, 0] > 0.0, local[:, 0], 1.0), 1.0)
            point = np.stack([place[:, 0] * scale, place[:, 1] * scale, inside[:, 1]], axis=1)
        contrast, gradient = field.evaluate(point)
        return self.ambient + contrast + dot(gradient, place - point), gradient

    def run(self) -> None:
        """Step until every ray has ended; the last steps of all rays are shortened together at the end."""
        flight, waiting = self.flight, []
        going = np.arange(len(self.state))
        while len(going):
            state = self.state[going]
            index, gradient = self.look(state[:, :3])
            h = (self.step or self.paper_step(state[:, :3])) / index
            after, deflection = self.nystrom(state, flight.direction[going], index, gradient, h)
            flight.steps[going] += 1
            flight.evaluations[going] += 4
            hit = np.zeros(len(going), dtype=bool)
            if self.ends.walls is not None:
                hit = self.ends.walls.contains(after[:, :3])
            over = np.stack([self.outside(after), self.stop_value(after, going)], axis=1) > 0.0
            ends = over.any(axis=1) & ~hit
            if ends.any():
                waiting.append((going[ends], index[ends], gradient[ends], h[ends], over[ends]))
            flight.hit[going[hit]] = True
            self.deflection[going] = np.maximum(self.deflection[going], deflection)
            move = ~ends
            self.state[going[move]] = after[move]
            going = going[move & ~hit]
        if waiting:
            self.land(*(np.concatenate(parts) for parts in zip(*waiting, strict=True)))

    def land(self, rows, index, gradient, h, over) -> None:
        """Shorten the last steps to where they meet the stop or the box, whichever comes first."""
        lengths = np.full(over.shape, np.inf)
        for column in (0, 1):
            some = np.flatnonzero(over[:, column])
            lengths[some, column] = self.shortened(column, rows[some], index[some], gradient[some], h[some])
        chosen = np.where(lengths[:, 1] < lengths[:, 0], 1, 0)
        h = lengths[np.arange(len(rows)), chosen]
        state = self.state[rows]
        self.state[rows], deflection = self.nystrom(state, self.flight.direction[rows], index, gradient, h)
        self.deflection[rows] = np.maximum(self.deflection[rows], deflection)
        self.flight.stopped[rows[chosen == 1]] = True
        self.flight.left[rows[chosen == 0]] = True

    def shortened(self, column, rows, index, gradient, h) -> np.ndarray:
        """The lengths at which the steps end on the box (0) or the stop (1)."""
        state, heading = self.state[rows], self.flight.direction[rows]

        def end(length):
            if column == 1 and isinstance(self.until, ArcLength):
                return self.stop_value(self.nystrom(state, heading, index, gradient, length)[0], rows)
            after = self.stages(state, index, gradient, length)[0]  # the place is enough
            return self.outside(after) if column == 0 else self.stop_value(after, rows)

        now = self.outside(state) if column == 0 else self.stop_value(state, rows)
        # A step from the face by which the ray entered starts on the surface: begin just behind it.
        low, high = np.where(now < 0.0, 0.0, 1e-6 * h), h.copy()
        at_once = end(low) >= 0.0
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            before = end(middle) < 0.0
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return np.where(at_once, 0.0, high)

    def outside(self, state) -> np.ndarray:
        """Distance of each ray outside the box [m]; negative inside."""
        place, low, high = state[:, :3], self.ends.low, self.ends.high
        if self.ends.axisymmetric:
            side = np.hypot(place[:, 0], place[:, 1]) - self.ends.radius
            return np.maximum(side, np.maximum(place[:, 2] - high[2], low[2] - place[:, 2]))
        return np.maximum(place - high, low - place).max(axis=1)

    def stop_value(self, state, rows) -> np.ndarray:
        """Negative before the user's stop, positive behind it."""
        if isinstance(self.until, Plane):
            return self.flight.side[rows] * ((state[:, :3] - self.until.point) @ self.until.normal)
        if isinstance(self.until, ArcLength):
            return state[:, ARC] - self.until.length
        return np.full(len(state), -1.0)

    def paper_step(self, place) -> np.ndarray:
        """Step of eq 5 in the cells of these places [m]."""
        samples, local = self.field.samples, self.field.local_coordinates(place)
        if not self.field.is_uniform:
            cell = samples.mesh.locate(local)
            return np.where(cell >= 0, samples.paper_step[cell], np.median(samples.paper_step))
        cell = np.floor((local - samples.origin) / samples.spacing).astype(np.int64)
        return samples.paper_step[tuple(np.clip(cell, 0, np.array(samples.shape) - 2).T)]

    def stages(self, state, index, gradient, h) -> tuple[np.ndarray, list, list]:
        """Where a step ends, which is the place of its last stage; index and force at the stages before it."""
        place, momentum, step = state[:, :3], state[:, 3:6], h[:, None]
        indices, forces = [index], [index[:, None] * gradient]
        for stage in range(1, 4):
            kick = sum(a * f for a, f in zip(A[stage], forces, strict=False))
            there = place + C[stage] * step * momentum + step**2 * kick
            if stage < 3:
                here, slope = self.look(there)
                indices.append(here)
                forces.append(here[:, None] * slope)
        return there, indices, forces

    def nystrom(self, state, heading, index, gradient, h) -> tuple[np.ndarray, np.ndarray]:
        """One step of the fourth-order formula, and the angles of the rays with their first directions."""
        momentum, step = state[:, 3:6], h[:, None]
        after = state.copy()
        after[:, :3], indices, forces = self.stages(state, index, gradient, h)
        here, slope = self.look(after[:, :3])
        indices.append(here)
        forces.append(here[:, None] * slope)
        after[:, 3:6] = momentum + step * sum(b * f for b, f in zip(BT, forces, strict=True))
        after[:, PATH] += h * sum(b * n * n for b, n in zip(BT, indices, strict=True))
        after[:, ARC] += h * sum(b * n for b, n in zip(BT, indices, strict=True))
        # The index jumps between a gap in a mesh and its cells, which no force tells.
        projects = self.consistent_gradient | ((index == self.ambient) != (here == self.ambient))
        scale = np.where(projects, here / np.linalg.norm(after[:, 3:6], axis=1), 1.0)
        after[:, 3:6] *= scale[:, None]
        if not self.consistent_gradient:
            return after, np.zeros(len(state))
        end_momentum = momentum + step * forces[-1]
        across = end_momentum - dot(end_momentum, heading)[:, None] * heading
        for b, row, n in zip(BT, STAGE_MOMENTUM, indices, strict=True):
            there = momentum + step * sum(w * f for w, f in zip(row, forces, strict=True))
            after[:, LAG] += h * b * _longitudinal_deficit(there, heading, n)
        return after, np.linalg.norm(across, axis=1) / self.ambient


def _longitudinal_deficit(momentum, heading, index) -> np.ndarray:
    """Return the index minus the momentum along the first direction, without cancellation."""
    ahead = dot(momentum, heading)
    across = momentum - ahead[:, None] * heading
    both = index + ahead
    return np.where(both > 0.0, dot(across, across) / np.where(both > 0.0, both, 1.0), 0.0)
