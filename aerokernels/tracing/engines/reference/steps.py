r"""The integrator of the reference engine: DOP853 in NumPy, all rays of a bundle together, each with its step length.

Over sigma, d sigma = ds / n, in deviation from the undisturbed ray p + t d, with the potential s = (n^2 - a^2) / 2:

    q' = P,    P' = grad s(r),    W' = 2 s,    S' = n - a = 2 s / (n + a),    r = p + t d + q,    t' = a,    T = a d + P

so that the optical path is a t + W and the arc length t + S, and an optical path difference has the rounding error of
its own size. Steps are of order 8 with error estimates of orders 5 and 3 (E. Hairer, S. P. Norsett, G. Wanner, Solving
Ordinary Differential Equations I, 1993), each within one smooth piece of the field: a step is shortened to where the
ray, as a parabola, first meets a face of its cell or its stop, and the rest is flown by Newton steps of second order. A
step whose error exceeds its share of the tolerance, or that passes a face, is repeated with a shorter length.

"straight" samples the field on the undisturbed line and continues the potential linearly to the ray.
"""

import numpy as np
from scipy.integrate import DOP853

from .flight import Flight, rising_root, starting_momentum
from .medium import dot

A, B, C, E3, E5 = (np.asarray(getattr(DOP853, name)) for name in ("A", "B", "C", "E3", "E5"))
STAGES = DOP853.n_stages
# Newton steps to a surface are of second order, so they may be at most this share of the step before them.
CLOSE = 1e-6
# Shortest step of error control [cells], and the shortest where slopes jump on the axis.
LEAST, LEAST_AT_KINK = 1e-7, 1e-11
# Rounding of an error estimate, in units of a step's; length of steps [cells] below which an estimate may be rounding.
NOISE, NOISE_STEP = 32.0, 1e-3
# Distance from the axis [cells] within which a ray hops over a kink on the axis.
HOP = 1e-7
EPSILON = np.finfo(np.float64).eps
# Crossings of faces without a step in between after which a ray is held on the face.
IDLE = 8
# Attempts that a ray may take for each step that it is allowed.
ATTEMPTS = 20


class Integrator:
    """Take a flight to its end: through `air` to `stop` (the `Ends` of ends.py), with `tolerance` in metres."""

    def __init__(self, air, ambient: float, stop, tolerance: float, max_steps: int, straight: bool):
        """Set what every step needs."""
        self.air, self.ambient, self.stop, self.walls, self.extent = air, ambient, stop, stop.walls, stop.extent
        self.tolerance, self.max_steps, self.straight = tolerance, max_steps, straight
        self.least = (LEAST_AT_KINK if air.axis_is_kink else LEAST) * air.size / ambient

    def run(self, flight: Flight) -> None:
        """Fly until every ray has ended."""
        count = len(flight.start)
        self.planned = np.full(count, 2.0 * self.air.size / self.ambient)
        self.aim = np.full(count, np.nan)
        # Crossings of faces without a step in between, and the normal of the ridge on which a ray is held.
        self.idle, self.ridge, self.has_ridges = np.zeros(count, dtype=np.int64), np.zeros((count, 3)), False
        # Greatest step, and error per length of the last step that was too inaccurate.
        self.cap, self.rejected_error = np.full(count, np.inf), np.full(count, np.inf)
        while len(rows := flight.going):
            gap = self.air.in_gap(flight.cell[rows])
            if gap.any():
                self.stop.glide(self, flight, rows[gap])
            if not gap.all():
                self.step(flight, rows[~gap])
            flight.attempts[rows] += 1
            over = (flight.steps[rows] >= self.max_steps) | (flight.attempts[rows] >= ATTEMPTS * self.max_steps)
            ended = flight.stopped[rows] | flight.left[rows] | flight.hit[rows] | flight.failed[rows]
            flight.spent[rows] = over & ~ended

    def place(self, flight: Flight, rows) -> np.ndarray:
        """Positions at which the field is sampled [m], shape (n, 3)."""
        line = flight.start[rows] + flight.along[rows, None] * flight.direction[rows]
        return line if self.straight else line + flight.q[rows]

    def begin(self, flight: Flight, rows) -> None:
        """Give rays the momentum with which they begin in their cells, on straight lines up to there."""
        place = self.place(flight, rows)
        potential, _ = self.air.frame(flight.cell[rows], place).sample(np.zeros_like(place))
        contrast = 2.0 * potential / (self.index(potential) + self.ambient)
        flight.momentum[rows] = starting_momentum(self.ambient, contrast, flight.direction[rows], flight.normal[rows])

    def enter(self, flight: Flight, rows) -> None:
        """Give rays at the start of their cells the momentum n d of their heading there, |T| = n."""
        tangent = self.ambient * flight.direction[rows] + flight.momentum[rows]
        heading = tangent / np.linalg.norm(tangent, axis=1)[:, None]
        place = self.place(flight, rows)
        potential, _ = self.air.frame(flight.cell[rows], place).sample(np.zeros_like(place))
        contrast = 2.0 * potential / (self.index(potential) + self.ambient)
        if self.straight:
            flight.momentum[rows] += contrast[:, None] * flight.direction[rows]
        else:
            turn = self.turn(flight.direction[rows], flight.momentum[rows])
            flight.momentum[rows] = contrast[:, None] * heading + self.ambient * turn

    def turn(self, direction, momentum) -> np.ndarray:
        """Unit tangent minus the first direction, without cancellation, shape (n, 3)."""
        tangent = self.ambient * direction + momentum
        size = np.linalg.norm(tangent, axis=1)
        excess = dot(2.0 * self.ambient * direction + momentum, momentum) / (size + self.ambient)  # size - ambient
        return (momentum - excess[:, None] * direction) / size[:, None]

    def index(self, potential) -> np.ndarray:
        """Index n of a potential."""
        return np.sqrt(np.maximum(self.ambient**2 + 2.0 * potential, 0.0))

    def events(self, frame, flight, rows, h, q, momentum, stretch, potential, force, wall):
        """Functions that rise through zero where a step must end: values [m], rates and curvatures, each (n, k)."""
        d = flight.direction[rows]
        tangent = self.ambient * d + momentum
        moved = (self.ambient * h)[:, None] * d
        if self.straight:
            line = np.broadcast_to(self.ambient * d, d.shape)
            parts = [frame.faces(moved, line, np.zeros_like(d))]
        else:
            parts = [frame.faces(moved + (q - flight.q[rows]), tangent, force)]
        along = flight.along[rows] + self.ambient * h
        parts.append(self.stop.event(flight, rows, along, q, tangent, force, stretch, self.index(potential)))
        if self.walls is not None:
            there = flight.start[rows] + along[:, None] * d + q
            parts.append(tuple(a[:, None] for a in self.walls.depth(wall, there, tangent, force)))
        return tuple(np.concatenate(group, axis=1) for group in zip(*parts, strict=True))

    def step(self, flight: Flight, rows: np.ndarray) -> None:
        """Attempt one step for each of the rays, all of which are in cells."""
        a, d, air = self.ambient, flight.direction[rows], self.air
        place = self.place(flight, rows)
        frame = air.frame(flight.cell[rows], place)
        q0, momentum0 = flight.q[rows], flight.momentum[rows]
        zero = np.zeros(len(rows))
        potential, force = self.sample(frame, rows, np.zeros_like(d), q0)
        wall, nearest = self.nearest_wall(flight, rows)
        stretch0 = flight.stretch[rows]
        value, rate, curve = self.events(frame, flight, rows, zero, q0, momentum0, stretch0, potential, force, wall)
        tolerance = 16.0 * EPSILON * (np.abs(place).max(axis=1) + self.extent)
        turning = np.zeros_like(value, dtype=bool)
        turning[:, : air.face_count] = frame.turning()
        root = rising_root(value, rate, 0.5 * curve, tolerance[:, None])
        root[turning & (value > -tolerance[:, None])] = np.inf
        if nearest is not None:
            root[~np.isfinite(nearest), -1] = np.inf
        hop = self.hops(value, turning, place, tolerance, root)
        # At a corner take the face that is crossed most steeply: between two cells a ray could go to and fro.
        chosen, each = root.argmin(axis=1), np.arange(len(rows))
        alike = ~turning & (root <= (root[each, chosen] + tolerance / a)[:, None])
        alike[:, air.face_count :] = False
        chosen = np.where(alike[each, chosen], np.where(alike, rate, -np.inf).argmax(axis=1), chosen)
        first = root[each, chosen]
        planned = np.minimum(self.planned[rows], self.cap[rows])
        lands = (first <= planned) & ~hop
        aim = self.aim[rows]
        h = np.where(lands, np.where(np.isfinite(aim), aim, first), planned)
        if hop.any():
            there = turning & hop[:, None]
            self.over_axis(flight, rows[hop], -2.0 * value[there] / rate[there], potential[hop])
        y0 = np.concatenate([q0, momentum0, flight.work[rows, None], stretch0[:, None]], axis=1)
        slopes = np.empty((STAGES + 1, len(rows), 8))
        slopes[0] = self.slope(momentum0, potential, force)
        for stage in range(1, STAGES + 1):
            weight, node = (A[stage, :stage], C[stage]) if stage < STAGES else (B, 1.0)
            y = y0 + h[:, None] * np.tensordot(weight, slopes[: len(weight)], axes=1)
            delta = (a * node * h)[:, None] * d
            if not self.straight:
                delta = delta + (y[:, :3] - q0)
            potential, force = self.sample(frame, rows, delta, y[:, :3])
            slopes[stage] = self.slope(y[:, 3:6], potential, force)
        flight.evaluations[rows] += STAGES
        error, rounding = self.estimate(flight, rows, h, slopes)
        value1, rate1, _ = self.events(frame, flight, rows, h, y[:, :3], y[:, 3:6], y[:, 7], potential, force, wall)
        finite = np.isfinite(y).all(axis=1) & np.isfinite(error)
        allowed = self.tolerance * a * h / self.extent + NOISE * rounding
        # An error that does not fall with the length of a short step is rounding.
        before = self.rejected_error[rows]
        stays = (before < np.inf) & (error > 0.5 * h * np.where(before < np.inf, before, 0.0))
        short = (h <= self.least) | ((h < NOISE_STEP * air.size / a) & stays)
        good = finite & ((error <= allowed) | short)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            self.rejected_error[rows] = np.where(good, np.inf, error / h)
            factor = np.where(error > 0.0, np.clip(0.9 * (allowed / error) ** 0.125, 0.2, 6.0), 6.0)

        # If the parabola missed a face, come closer first.
        at = (np.arange(len(rows)), chosen)
        with np.errstate(divide="ignore", invalid="ignore"):
            miss = np.where(lands, -value1[at] / rate1[at], 0.0)
        there = np.abs(value1[at]) <= tolerance
        off = lands & ~(np.abs(miss) <= CLOSE * h) & ~there
        miss = np.where(np.isfinite(miss) & ~(there & (np.abs(miss) > CLOSE * h)), miss, 0.0)  # on a face it grazes
        if nearest is not None:  # the lines through walls that are not ahead do not count
            value[~np.isfinite(nearest), -1] = value1[~np.isfinite(nearest), -1] = -np.inf
        others = np.where(turning, -np.inf, value1)
        others[at] = np.where(lands, -np.inf, others[at])
        passed = (others > tolerance[:, None]).any(axis=1)
        passed |= self.bulges(value, rate, value1, rate1, h, tolerance, turning, lands, chosen)
        if self.walls is not None:
            passed |= self.in_body(flight, rows, h, y) & ~(lands & (chosen == value.shape[1] - 1))
        retake = good & (off | passed) & (h > tolerance / a)
        off &= h > tolerance / a
        accept = good & ~retake & ~hop
        # Repeat by Newton if the face was missed and is near, else with half the length.
        near = retake & ~passed & (np.abs(miss) < 0.1 * h)
        self.aim[rows] = np.where(near, h + miss, np.nan)
        self.cap[rows] = np.where(retake & ~near, 0.5 * h, np.inf)
        grown = h * factor
        kept = accept & (lands | (self.planned[rows] > h))
        grown = np.maximum(grown, 2.0 * self.least)
        self.planned[rows] = np.where(
            accept,
            np.where(kept, np.maximum(self.planned[rows], grown), grown),
            np.where(good | hop, self.planned[rows], h * np.where(finite, np.minimum(factor, 0.8), 0.25)),
        )
        flight.failed[rows[~finite & (h <= self.least)]] = True
        if accept.any():
            self.accept(
                flight, rows, accept, lands & ~off, chosen, h, y, potential, force, miss, error + rounding, turning
            )

    def accept(self, flight, rows, accept, lands, chosen, h, y, potential, force, miss, error, turning) -> None:
        """Move rays to the ends of their steps, and on to the surfaces that they meet."""
        a = self.ambient
        kept = rows[accept]
        flight.steps[kept] += 1
        flight.error[kept] += error[accept]
        flight.along[kept] += a * h[accept]
        flight.q[kept], flight.momentum[kept] = y[accept, :3], y[accept, 3:6]
        flight.work[kept], flight.stretch[kept] = y[accept, 6], y[accept, 7]
        down = accept & lands
        if not down.any():
            return
        rows, chosen, rest = rows[down], chosen[down], miss[down]
        potential, force = potential[down], force[down]
        self.drift(flight, rows, rest, potential, force)
        face = chosen < self.air.face_count
        flight.stopped[rows[chosen == self.air.face_count]] = True
        flight.hit[rows[chosen > self.air.face_count]] = True
        face &= ~turning[down][np.arange(len(rows)), chosen]
        rows, chosen = rows[face], chosen[face]
        if not len(rows):
            return
        tangent = a * flight.direction[rows] + (0.0 if self.straight else flight.momentum[rows])
        cell, left = self.air.cross(flight.cell[rows], chosen, self.place(flight, rows), tangent)
        self.hold(flight, rows, chosen, h[down][face] <= self.least)
        if self.straight:
            leaves = left | self.air.in_gap(cell)
            self.stop.settle(self, flight, rows[leaves], chosen[leaves], potential[face][leaves], force[face][leaves])
        flight.cell[rows] = cell
        flight.left[rows[left]] = True

    def hold(self, flight, rows, chosen, idle) -> None:
        """Hold rays on a ridge of the index, where slopes on both sides drive them back to it repeatedly."""
        self.idle[rows] = np.where(idle, self.idle[rows] + 1, 0)
        if self.has_ridges:
            self.ridge[rows[~idle]] = 0.0
        stuck = self.idle[rows] >= IDLE
        if stuck.any():
            rows, chosen = rows[stuck], chosen[stuck]
            normal = self.air.normal(flight.cell[rows], chosen, self.place(flight, rows))
            self.ridge[rows], self.idle[rows], self.has_ridges = normal, 0, True
            flight.momentum[rows] -= dot(flight.momentum[rows], normal)[:, None] * normal

    def drift(self, flight, rows, h, potential, force) -> None:
        """Take a Newton step of second order, forward or back."""
        a, step = self.ambient, h[:, None]
        momentum = flight.momentum[rows]
        index = self.index(potential)
        rise = dot(force, a * flight.direction[rows] + momentum)  # ds / d sigma
        flight.along[rows] += a * h
        flight.q[rows] += step * momentum + 0.5 * step**2 * force
        flight.momentum[rows] += step * force
        flight.work[rows] += h * (2.0 * potential + rise * h)
        flight.stretch[rows] += h * (2.0 * potential / (index + a) + 0.5 * rise / index * h)

    def over_axis(self, flight, rows, h, potential) -> None:
        """Step over the kink on the axis to the mirrored position: the forces on both sides cancel."""
        self.drift(flight, rows, h, potential, np.zeros((len(rows), 3)))
        flight.steps[rows] += 1

    def hops(self, value, turning, place, tolerance, root) -> np.ndarray:
        """Rays that hop over a kink on the axis because they are close and head straight for it; others aim short."""
        result = np.zeros(len(place), dtype=bool)
        if not self.air.axis_is_kink or self.straight:
            return result
        column = turning.any(axis=0).argmax()
        before = -value[:, column]
        size = self.air.size
        beside = np.sqrt(np.maximum(dot(place[:, :2], place[:, :2]) - before**2, 0.0))
        close = (before > tolerance) & (before < HOP * size) & (beside < 0.01 * HOP * size)
        aims = np.isfinite(root[:, column]) & ~close & (beside < 1e-3 * before)
        root[aims, column] *= 0.999
        return close & (root[:, column] <= root.min(axis=1))

    def sample(self, frame, rows, delta, q) -> tuple[np.ndarray, np.ndarray]:
        """Potential and force on the ray, or continued from the line; no force across a ridge that holds the ray."""
        potential, force = frame.sample(delta)
        if self.has_ridges:
            ridge = self.ridge[rows]
            force = force - dot(force, ridge)[:, None] * ridge
        return (potential + dot(force, q), force) if self.straight else (potential, force)

    def slope(self, momentum, potential, force) -> np.ndarray:
        """The right side of the equations, shape (n, 8)."""
        twice = 2.0 * potential[:, None]
        return np.concatenate([momentum, force, twice, twice / (self.index(potential) + self.ambient)[:, None]], axis=1)

    def estimate(self, flight, rows, h, slopes) -> tuple[np.ndarray, np.ndarray]:
        """Errors of a step as optical path [m]: the error by the embedded formulas, and the rounding."""
        fifth, third = np.tensordot(E5, slopes, axes=1), np.tensordot(E3, slopes, axes=1)
        lever_arm, gain = flight.lever_arm[rows], flight.gain[rows]
        total, floor = np.zeros(len(rows)), np.zeros(len(rows))
        for part, weight in (
            (slice(0, 3), self.ambient * gain),
            (slice(3, 6), lever_arm * gain),
            (slice(6, 7), 1.0),
            (slice(7, 8), self.ambient),
        ):
            high, low = dot(fifth[:, part], fifth[:, part]), dot(third[:, part], third[:, part])
            both = high + 0.01 * low
            total += weight * np.where(both > 0.0, high / np.sqrt(np.where(both > 0.0, both, 1.0)), 0.0)
            floor += weight * np.abs(slopes[:, :, part]).max(axis=(0, 2))
        floor += lever_arm * gain * self.air.force_scale
        return h * total, EPSILON * h * floor

    def bulges(self, value, rate, value1, rate1, h, tolerance, turning, lands, chosen) -> np.ndarray:
        """Rays that leave their cell and return within a step, by the cubic through values and rates at its ends."""
        turns = (rate > 0.0) & (rate1 < 0.0) & ~turning & np.isfinite(value)
        turns[np.arange(len(h)), chosen] &= ~lands
        result = np.zeros(len(h), dtype=bool)
        row, column = np.nonzero(turns)
        v0, v1 = value[row, column], value1[row, column]
        r0, r1 = rate[row, column] * h[row], rate1[row, column] * h[row]
        c2, c3 = 3.0 * (v1 - v0) - 2.0 * r0 - r1, r0 + r1 - 2.0 * (v1 - v0)
        with np.errstate(divide="ignore", invalid="ignore"):  # for numbers so small that their squares are zero
            at = r0 / (np.sqrt(np.maximum(c2 * c2 - 3.0 * c3 * r0, 0.0)) - c2)  # where it is greatest
        peak = ((c3 * at + c2) * at + r0) * at + v0
        np.logical_or.at(result, row, peak > tolerance[row])
        return result

    def nearest_wall(self, flight, rows) -> tuple[np.ndarray | None, np.ndarray | None]:
        """The wall that each ray would meet first if it went straight on, and its distance [m]."""
        if self.walls is None:
            return None, None
        tangent = self.ambient * flight.direction[rows] + flight.momentum[rows]
        heading = tangent / np.linalg.norm(tangent, axis=1)[:, None]
        there = flight.start[rows] + flight.along[rows, None] * flight.direction[rows] + flight.q[rows]
        distance, wall = self.walls.first_crossing(there, heading, inward=True, least=-1e-9 * self.air.size)
        return wall, distance

    def in_body(self, flight, rows, h, y) -> np.ndarray:
        """Whether the ends of steps are inside the body."""
        there = flight.start[rows] + (flight.along[rows] + self.ambient * h)[:, None] * flight.direction[rows]
        return self.walls.contains(there + y[:, :3])
