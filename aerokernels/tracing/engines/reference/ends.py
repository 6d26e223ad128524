"""Both ends of the reference engine's rays: from the start to the field, and from the last step to the stop."""

from dataclasses import dataclass

import numpy as np

from ....medium import Body, IndexField, SolidBody
from ...scheme import ENTRY_ROUNDING, LEAST_SLOPE
from ...stop import ArcLength, Plane, RayStatus
from .flight import Flight, Segments, Triangles
from .medium import dot, outward, plane_motion
from .steps import EPSILON, Integrator

# Never divide by a cosine at the stop that is smaller than this.
LEAST_COSINE = 1e-3


class Walls(Segments):
    """The surface of a body in the plane."""

    def __init__(self, body: Body):
        """Take its segments, which have the solid on their left."""
        super().__init__(*body.surface, body.geometry == "axisymmetric")
        self.body = body

    def outward(self, which: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Unit normals at places (n, 3) on the segments `which`, shape (n, 3)."""
        there = plane_motion(place, np.zeros_like(place), np.zeros_like(place), self.axisymmetric)[0]
        share = dot(there - self.start[which], self.step[which]) / self.length[which] ** 2
        first, second = self.body.normals[which].swapaxes(0, 1)
        normal = first + share[:, None] * (second - first)
        beside = outward(place) if self.axisymmetric else np.array([0.0, 1.0, 0.0])
        normal = normal[:, :1] * beside + normal[:, 1:] * [0.0, 0.0, 1.0]
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])

    def contains(self, place: np.ndarray) -> np.ndarray:
        """Whether places (n, 3) are inside the body."""
        zero = np.zeros_like(place)
        return self.body.contains(plane_motion(place, zero, zero, self.axisymmetric)[0])


class SurfaceWalls(Triangles):
    """The surface of a body in a volume."""

    def __init__(self, body: SolidBody):
        """Take its triangles."""
        super().__init__(body.surface)
        self.body = body

    def outward(self, which: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Unit normals at places (n, 3) on the triangles `which`, shape (n, 3)."""
        shares = np.einsum("nk,njk->nj", place - self.corner[which], self.share[which])
        shares = np.concatenate([1.0 - shares.sum(axis=1)[:, None], shares], axis=1)
        normal = np.einsum("nj,njk->nk", shares, self.body.normals[which])
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])

    def contains(self, place: np.ndarray) -> np.ndarray:
        """Whether places (n, 3) are inside the body."""
        return self.body.contains(place)


def walls_of(body: Body | SolidBody | None) -> Walls | SurfaceWalls | None:
    """Return the surface of a body, None without a body."""
    return None if body is None else SurfaceWalls(body) if isinstance(body, SolidBody) else Walls(body)


@dataclass
class Interval:
    """The undisturbed rays: distances at which they enter and leave the field and meet the stop [m]; their status.

    `normal` (n, 3) is the body's outward normal where rays leave the body in which they start, zero for others.
    """

    t_enter: np.ndarray
    t_exit: np.ndarray
    stop: np.ndarray
    has_stop: np.ndarray
    meets: np.ndarray
    status: np.ndarray
    normal: np.ndarray


class Ends:
    """The box of a field, and the stop."""

    def __init__(self, field: IndexField, until):
        """Take the box of the field."""
        self.field, self.until, self.ambient = field, until, field.ambient_index
        self.low, self.high = field.box
        self.axisymmetric = field.geometry == "axisymmetric"
        self.radius = self.high[0] if self.axisymmetric else np.inf
        self.walls = walls_of(field.body)
        extent = np.where(np.isfinite(self.high - self.low), self.high - self.low, 0.0)
        self.extent = float(np.linalg.norm(extent))

    def span(self, place, heading) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] at which straight rays enter and leave the box, negative behind them; entry > exit: a miss."""
        low, high = self.low.copy(), self.high.copy()
        if self.axisymmetric:
            low[:2], high[:2] = -np.inf, np.inf
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (low - place) / heading, (high - place) / heading
        beside = heading == 0.0
        missed = (beside & ((place < low) | (place > high))).any(axis=1)
        near = np.where(beside, -np.inf, np.minimum(one, other)).max(axis=1)
        far = np.where(beside, np.inf, np.maximum(one, other)).min(axis=1)
        if self.axisymmetric:
            square = dot(heading[:, :2], heading[:, :2])
            safe = np.where(square > 0.0, square, 1.0)
            middle = -dot(place[:, :2], heading[:, :2]) / safe
            foot = place[:, :2] + middle[:, None] * heading[:, :2]
            rest = self.radius**2 - dot(foot, foot)
            half = np.sqrt(np.maximum(rest, 0.0) / safe)
            across = square > 0.0
            missed |= np.where(across, rest < 0.0, dot(place[:, :2], place[:, :2]) > self.radius**2)
            near = np.where(across, np.maximum(near, middle - half), near)
            far = np.where(across, np.minimum(far, middle + half), far)
        return np.where(missed, 1.0, near), np.where(missed, -1.0, far)

    def interval(self, start, heading) -> Interval:
        """Return the undisturbed rays as an Interval, with the status of those that end before they enter the field."""
        near, leave = self.span(start, heading)
        meets, enter = (near <= leave) & (leave >= 0.0), np.maximum(near, 0.0)
        status = np.full(len(start), RayStatus.OK, dtype=np.int64)
        has_stop = np.ones(len(start), dtype=bool)
        if isinstance(self.until, Plane):
            height, slope = (start - self.until.point) @ self.until.normal, heading @ self.until.normal
            has_stop = (height == 0.0) | ((height * slope < 0.0) & (np.abs(slope) > LEAST_SLOPE))
            stop = np.where(height == 0.0, 0.0, -height / np.where(slope != 0.0, slope, 1.0))
        elif isinstance(self.until, ArcLength):
            stop = np.full(len(start), self.until.length)
        else:
            stop = leave
            status[meets & ~np.isfinite(leave)] = RayStatus.STOP_NOT_REACHED  # along x a planar field is infinite
        stops = has_stop & (self.until is not None)
        meets &= ~(stops & (stop <= enter))
        normal = np.zeros_like(start)
        if self.walls is not None:
            inside = np.flatnonzero(meets)
            # If the body extends beyond the box, a ray may hit the body before it reaches the box.
            hits = self.walls.first_crossing(start[inside], heading[inside], inward=True, least=0.0)[0]
            hit = (enter[inside] > 0.0) & (hits <= (1.0 + ENTRY_ROUNDING) * enter[inside])
            enter[inside[hit]] = hits[hit]
            status[inside[hit]] = RayStatus.HIT_BODY
            inside = inside[~hit]
            inside = inside[self.walls.contains(start[inside] + enter[inside, None] * heading[inside])]
            entry = start[inside] + enter[inside, None] * heading[inside]
            distance, which = self.walls.first_crossing(entry, heading[inside], inward=False, least=0.0)
            out = enter[inside] + distance
            leaves = np.isfinite(out)
            some = inside[leaves]
            normal[some] = self.walls.outward(which[leaves], start[some] + out[leaves, None] * heading[some])
            enter[inside] = np.minimum(out, leave[inside])
            stopped = stops[inside] & (stop[inside] <= enter[inside])
            meets[inside[stopped]] = False
            status[inside] = np.where(stopped, RayStatus.OK, status[inside])
            # A ray that leaves the body where the box ends meets no air.
            status[inside[~stopped & ~(out < (1.0 - ENTRY_ROUNDING) * leave[inside])]] = RayStatus.INSIDE_BODY
        if self.until is None:
            status[~meets & (status == RayStatus.OK)] = RayStatus.MISSED_FIELD
        return Interval(enter, leave, stop, has_stop, meets, status, normal)

    def flight(self, start, heading, interval: Interval, cell) -> Flight:
        """Return the rays at the positions where they enter the field."""
        stops = interval.has_stop & (self.until is not None)
        side = np.ones(len(start))
        cosine = np.ones(len(start))
        if isinstance(self.until, Plane):
            side = np.where((start - self.until.point) @ self.until.normal > 0.0, -1.0, 1.0)
            cosine = np.abs(heading @ self.until.normal)
        elif self.until is None:
            cosine = self.leaving_cosine(start + interval.t_exit[:, None] * heading, heading)
        beyond = np.where(stops, np.maximum(interval.stop - interval.t_exit, 0.0), 0.0)
        gain = 1.0 / np.maximum(cosine, LEAST_COSINE)
        lever_arm = self.extent + (np.sqrt(1.0 - np.minimum(cosine, 1.0) ** 2) + 0.05) * beyond
        flight = Flight(start, heading, side, interval.t_enter.copy(), lever_arm, gain, cell)
        flight.normal = interval.normal
        return flight

    def leaving_cosine(self, place, heading) -> np.ndarray:
        """Cosine of the angle at which straight rays leave the box at these places."""
        low = 2 if self.axisymmetric else 1 if self.field.geometry == "planar" else 0
        face = np.where(heading[:, low:] > 0.0, self.high[low:] - place[:, low:], place[:, low:] - self.low[low:])
        nearest = np.abs(face).argmin(axis=1)
        rows = np.arange(len(place))
        miss, cosine = np.abs(face[rows, nearest]), np.abs(heading[rows, low + nearest])
        if self.axisymmetric:
            radius = np.hypot(place[:, 0], place[:, 1])
            by_side = np.abs(radius - self.radius) < miss
            outward = np.abs(dot(place[:, :2], heading[:, :2])) / np.where(radius > 0.0, radius, 1.0)
            cosine = np.where(by_side, outward, cosine)
        return cosine

    def event(self, flight: Flight, rows, along, q, tangent, force, stretch, index):
        """The stop as a function that rises through zero [m], with its rate and curvature over sigma; (n, 1) each."""
        if isinstance(self.until, Plane):
            side, normal = flight.side[rows], self.until.normal
            line = flight.start[rows] + along[:, None] * flight.direction[rows]
            value = ((line - self.until.point) @ normal + q @ normal) * side
            rate, curve = (tangent @ normal) * side, (force @ normal) * side
        elif isinstance(self.until, ArcLength):
            value = along + stretch - self.until.length
            rate, curve = index, dot(force, tangent) / np.where(index > 0.0, index, 1.0)
        else:
            value, rate, curve = np.full(len(along), -np.inf), np.zeros(len(along)), np.zeros(len(along))
        return value[:, None], rate[:, None], curve[:, None]

    def glide(self, integrator: Integrator, flight: Flight, rows) -> None:
        """Fly straight through a gap: to a cell, the stop, the body or the end of the box."""
        a, d = self.ambient, flight.direction[rows]
        turn = integrator.turn(d, flight.momentum[rows])
        flight.momentum[rows] = a * turn
        place = integrator.place(flight, rows)
        there = flight.start[rows] + flight.along[rows, None] * d + flight.q[rows]
        heading = d + turn
        bearing = d if integrator.straight else heading
        ahead = np.full((len(rows), 4), np.inf)
        ahead[:, 0], cell = integrator.air.reenter(place, bearing)
        ahead[:, 1] = np.maximum(self.span(place, bearing)[1], 0.0)
        if isinstance(self.until, Plane):
            height, slope = (there - self.until.point) @ self.until.normal, heading @ self.until.normal
            meets = slope * flight.side[rows] > 0.0
            ahead[meets, 2] = np.maximum(-height[meets] / slope[meets], 0.0)
        elif isinstance(self.until, ArcLength):
            ahead[:, 2] = self.until.length - flight.along[rows] - flight.stretch[rows]
        if self.walls is not None:
            ahead[:, 3] = np.maximum(
                self.walls.first_crossing(there, heading, True, -1e-9 * integrator.air.size)[0], 0.0
            )
        chosen = np.array([2, 0, 3, 1])[ahead[:, [2, 0, 3, 1]].argmin(axis=1)]
        distance = ahead[np.arange(len(rows)), chosen]
        lost = ~np.isfinite(distance)
        distance[lost] = 0.0
        flight.spent[rows[lost]] = True  # along x in a planar field, which has no end there
        flight.along[rows] += distance
        flight.q[rows] += distance[:, None] * turn
        flight.steps[rows] += 1
        flight.left[rows[chosen == 1]] = True
        flight.stopped[rows[chosen == 2]] = True
        flight.hit[rows[chosen == 3]] = True
        entering = chosen == 0
        flight.cell[rows[entering]] = cell[entering]
        integrator.enter(flight, rows[entering])

    def settle(self, integrator: Integrator, flight: Flight, rows, face, potential, force) -> None:
        """Fly rays on, or back, to the face through which their undisturbed lines leave the field's air.

        They are beside their lines, and the air ends at the face: without this the optical path would hold the air of
        a contrast m over a length of m L too much, L being the length of the line.
        """
        normal = integrator.air.normal(flight.cell[rows], face, integrator.place(flight, rows))
        rate = dot(self.ambient * flight.direction[rows] + flight.momentum[rows], normal)
        steep = np.abs(rate) > LEAST_COSINE * self.ambient
        h = np.where(steep, -dot(flight.q[rows], normal) / np.where(steep, rate, 1.0), 0.0)
        integrator.drift(flight, rows, h, potential, force)

    def finish(
        self, interval: Interval, rows, flight: Flight | None, turn, start, heading, straight: bool
    ) -> dict[str, np.ndarray]:
        """Return the results of all rays; `rows` flew, and `turn` are their tangents minus the first directions."""
        count = len(start)
        along, work, stretch, error = (np.zeros(count) for _ in range(4))
        q, turned = np.zeros((count, 3)), np.zeros((count, 3))
        steps, evaluations = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        status, at_stop = interval.status.copy(), np.zeros(count, dtype=bool)
        hit = status == RayStatus.HIT_BODY
        along[hit] = interval.t_enter[hit]
        if flight is not None:
            along[rows], work[rows], stretch[rows], error[rows] = (
                flight.along,
                flight.work,
                flight.stretch,
                flight.error,
            )
            q[rows], turned[rows] = flight.q, turn
            steps[rows], evaluations[rows], at_stop[rows] = flight.steps, flight.evaluations, flight.stopped
            status[rows[flight.hit]] = RayStatus.HIT_BODY
            status[rows[flight.spent]] = RayStatus.MAX_STEPS
            status[rows[flight.failed]] = RayStatus.NOT_FINITE
        if self.until is not None:
            flies = (status == RayStatus.OK) & ~at_stop
            distance, reaches = self.distance_to_stop(
                start + along[:, None] * heading + q, heading + turned, along + stretch, heading
            )
            status[flies & ~reaches] = RayStatus.STOP_NOT_REACHED
            distance = np.where(flies & reaches, distance, 0.0)
            along += distance
            q += distance[:, None] * turned
        elif straight and flight is not None:
            # The undisturbed line ends on a face of the box; the ray ends beside it and flies on, or back, to the face.
            leaves = rows[flight.left]
            place = start[leaves] + along[leaves, None] * heading[leaves] + q[leaves]
            near, far = self.span(place, heading[leaves] + turned[leaves])
            distance = np.where(near <= far, far, 0.0)
            along[leaves] += distance
            q[leaves] += distance[:, None] * turned[leaves]
        good = (status == RayStatus.OK) & interval.has_stop
        further = np.zeros(count)
        further[good] = along[good] - interval.stop[good]
        if not isinstance(self.until, ArcLength):
            further[good] = self.further(interval.stop[good], start[good], heading[good], q[good], further[good])
        opd = work - self.ambient * stretch
        if not isinstance(self.until, ArcLength):
            opd = np.where(good, work + self.ambient * further, opd)
        error[rows] += (
            4.0 * EPSILON * (self.extent + np.linalg.norm(q[rows], axis=1) * (flight.gain if flight else 1.0))
        )
        tangent = heading + turned
        return {
            "position": start + along[:, None] * heading + q,
            "direction": tangent / np.linalg.norm(tangent, axis=1)[:, None],
            "optical_path": np.maximum(self.ambient * along + work, 0.0),
            "opd": opd,
            "arc_length": np.maximum(along + stretch, 0.0),
            "step_error": error,
            "step_count": steps,
            "evaluation_count": evaluations,
            "status": status.astype(np.int32),
        }

    def distance_to_stop(self, place, tangent, arc, first) -> tuple[np.ndarray, np.ndarray]:
        """Distance that rays outside the box have to fly straight on to the stop [m], and whether they reach it.

        A ray whose direction `first`, at its start, is parallel to a plane never reaches it: the undisturbed ray does
        not meet the plane, so that there is no path to compare with.
        """
        if isinstance(self.until, ArcLength):
            return self.until.length - arc, np.ones(len(place), dtype=bool)
        height, slope = (place - self.until.point) @ self.until.normal, tangent @ self.until.normal
        # If the plane is on a face of the box, rounding may have put the ray behind the plane.
        close = np.abs(height) <= 64.0 * EPSILON * (self.extent + np.abs(place).max(axis=1))
        parallel = np.minimum(np.abs(slope), np.abs(first @ self.until.normal)) <= LEAST_SLOPE
        reaches = ((height * slope < 0.0) & ~parallel) | close
        distance = np.where(slope != 0.0, -height / np.where(slope != 0.0, slope, 1.0), 0.0)
        return np.where(close & (np.abs(slope) < LEAST_COSINE), 0.0, distance), reaches

    def further(self, stop, start, heading, q, difference) -> np.ndarray:
        """How much further along its first direction each ray ends than the undisturbed ray, from its deviation q [m].

        `difference` is the difference of the two distances, which has lost digits. It is returned for a ray that ends
        on another face than the undisturbed ray, or meets that face too obliquely.
        """
        best = difference.copy()
        if isinstance(self.until, Plane):
            _take(best, True, -(q @ self.until.normal), heading @ self.until.normal)
            return best
        ideal = start + stop[:, None] * heading
        real = ideal + difference[:, None] * heading + q
        close = 1e-12 * (self.extent + np.abs(ideal).max(axis=1, initial=0.0))

        def on_both(distance) -> np.ndarray:
            return (np.abs(distance(ideal)) <= close) & (np.abs(distance(real)) <= close)

        for axis in range(2 if self.axisymmetric else 1 if self.field.geometry == "planar" else 0, 3):
            for face in (self.low[axis], self.high[axis]):
                on = on_both(lambda place, axis=axis, face=face: place[:, axis] - face)
                _take(best, on, -q[:, axis], heading[:, axis])
        if self.axisymmetric:
            # |foot + f d + q| = |foot| across the axis, for f
            foot, across = ideal[:, :2], heading[:, :2]
            middle, rest = dot(across, foot + q[:, :2]), dot(2.0 * foot + q[:, :2], q[:, :2])
            root = np.sqrt(np.maximum(middle**2 - dot(across, across) * rest, 0.0))
            on = on_both(lambda place: np.hypot(place[:, 0], place[:, 1]) - self.radius)
            _take(best, on, -rest / self.radius, (middle + root) / self.radius)
        return best


def _take(best, on, share, rate) -> None:
    """Set `best` to share / rate where `on` holds and the rate is more than rounding."""
    good = on & (np.abs(rate) > LEAST_COSINE)
    best[good] = share[good] / rate[good]
