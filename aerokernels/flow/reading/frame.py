"""The optical frame in the file's axes: viewing direction, upward direction and origin.

In the optical frame z is the optical axis and points upstream, y is up (the direction of target tilt), x = y cross z. A
`Frame` states where these axes are in the file. What it leaves out follows from the kind of file:

    volume          the file's x, y, z are taken as they are
    plane y-z       likewise
    plane x-y       z = -x, y = y: the flow runs along +x, as in the shipped fields
    plane x-z       z = -x, y = z
    axisymmetric    z against the axis of symmetry (-x, if the file does not name one), r the distance from it
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from aerokernels.flow.reading.arrays import plain_name
from aerokernels.flow.reading.dataset import Dataset, ReadError
from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import quantity


@dataclass(frozen=True)
class Frame:
    """Position of the optical frame in a file's axes.

    Attributes:
        optical: The optical axis z in the file's axes: "-x", "+y", ... or a vector; None follows from the file.
        up: The axis y, likewise, perpendicular to `optical`; None takes the first of y, z, x that is perpendicular.
        flow: The direction of the flow: an alternative to `optical`, which points against it.
        origin: The point of the file that becomes the origin, in the file's unit.
        rotation: Angle about x by which the optical axis is turned toward up [rad], or a text such as "10 deg".

    Raises:
        TypeError: A value that is not an axis.
        ValueError: An unknown axis, both `optical` and `flow`, axes that are not perpendicular.
    """

    optical: str | tuple[float, float, float] | None = None
    up: str | tuple[float, float, float] | None = None
    flow: str | tuple[float, float, float] | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: float | str = 0.0

    def __post_init__(self):
        """Check what can be checked without a file."""
        if self.optical is not None and self.flow is not None:
            raise ValueError("frame: give either the optical axis or the flow's direction, not both")
        origin = np.asarray(self.origin, dtype=np.float64)
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise ValueError(f"frame: origin must be three finite coordinates, got {self.origin!r}")
        object.__setattr__(self, "origin", tuple(float(v) for v in origin))
        object.__setattr__(self, "rotation", quantity(self.rotation, "angle"))
        look, up = self.look, None if self.up is None else direction(self.up, "up")
        if look is not None and up is not None and abs(look @ up) > 1e-9:
            raise ValueError(
                f"frame: up {self.up!r} is not at right angles to the optical axis {self.optical or self.flow!r}"
            )

    @classmethod
    def of(cls, given) -> "Frame":
        """Return a frame from None, a Frame, the optical axis alone, or a mapping of its attributes.

        Raises:
            TypeError: A value of another kind.
            ValueError: An unknown key, or values that `Frame` rejects.
        """
        if isinstance(given, cls):
            return given
        if given is None:
            return cls()
        if isinstance(given, Mapping):
            known = [entry.name for entry in fields(cls)]
            if unknown := set(given) - set(known):
                raise ValueError(f"frame: {sorted(unknown)[0]!r} is not known: choose of {', '.join(known)}")
            values: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in given.items()}
            return cls(**values)
        if isinstance(given, str):
            return cls(optical=given)
        raise TypeError(f"frame must be a Frame, a mapping or an optical axis such as '-x', got {type(given).__name__}")

    @property
    def look(self) -> np.ndarray | None:
        """The optical axis in the file's axes before `rotation`, or None."""
        if self.optical is not None:
            return direction(self.optical, "optical")
        return None if self.flow is None else -direction(self.flow, "flow")

    def axes(self, flat_along: np.ndarray | None = None) -> np.ndarray:
        """Return unit vectors x, y, z of the optical frame in the file's axes, as rows, shape (3, 3).

        `flat_along` is the normal of the plane of a two-dimensional file; None for a volume.
        """
        look, up = self.look, None if self.up is None else direction(self.up, "up")
        if flat_along is not None:
            for name, axis in (("optical axis", look), ("up", up)):
                if axis is not None and abs(axis @ flat_along) > 1e-6:
                    raise ValueError(f"frame: {name} {axis.tolist()} points out of the plane of the file")
        if look is None:
            across = flat_along is None or abs(flat_along[0]) > 0.5
            look = np.array([0.0, 0.0, 1.0] if across else [-1.0, 0.0, 0.0])
            if flat_along is not None:
                look = _unit(look - flat_along * (look @ flat_along))
            if up is not None and abs(up @ look) > 1e-9:
                raise ValueError(f"frame: up {self.up!r} needs an optical axis beside it: give optical = '-x', say")
        if up is None:
            if flat_along is not None:
                up = np.cross(look, flat_along)
                up = up * (1.0 if up[int(np.argmax(np.abs(up)))] > 0.0 else -1.0)
            else:
                in_order = [np.eye(3)[k] for k in (1, 2, 0)]
                up = next((e for e in in_order if abs(e @ look) < 1e-9), None)
                if up is None:
                    free = in_order[int(np.argmin([abs(e @ look) for e in in_order]))]
                    up = _unit(free - look * (free @ look))
        angle = float(self.rotation)
        look, up = np.cos(angle) * look + np.sin(angle) * up, np.cos(angle) * up - np.sin(angle) * look
        return np.stack([np.cross(up, look), up, look]) + 0.0

    def described(self, axes: np.ndarray) -> str:
        """Describe the frame, for pictures and provenance: "z along -x, y along +y of the file"."""
        named = []
        for name, row in (("z", axes[2]), ("y", axes[1])):
            k = int(np.argmax(np.abs(row)))
            exact = abs(abs(row[k]) - 1.0) < 1e-12
            along = f"{'-' if row[k] < 0 else '+'}{'xyz'[k]}" if exact else np.round(row, 6).tolist()
            named.append(f"{name} along {along}")
        origin = "" if not any(self.origin) else f", origin at {list(self.origin)}"
        return ", ".join(named) + " of the file" + origin


def direction(value, name: str) -> np.ndarray:
    """Return a unit vector from "+x", "-y", "z" or three numbers."""
    if isinstance(value, str):
        sign, axis = (-1.0, value[1:]) if value[:1] == "-" else (1.0, value.removeprefix("+"))
        number = "xyz".find(axis.strip().lower() or "?")
        if number < 0 or len(axis.strip()) != 1:
            raise ValueError(
                f"frame: {name} {value!r} is not an axis: give one of +x, -x, +y, -y, +z, -z, or three numbers"
            )
        return sign * np.eye(3)[number]
    message = f"frame: {name} must be an axis such as '-x' or three numbers, got {value!r}"
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(message) from None
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise ValueError(message)
    return _unit(vector)


def plane_normal(points: np.ndarray) -> np.ndarray | None:
    """Return the normal of the plane that contains all points, or None where they fill a volume."""

    def normal_and_depth(points: np.ndarray) -> tuple[np.ndarray, float]:
        centred = points - points.mean(axis=0)
        normal = np.linalg.eigh(centred.T @ centred / len(points))[1][:, 0]
        return normal, float(np.ptp(centred @ normal))

    if len(points) > 20_000:  # a sample may show that they are so far from any plane that more cannot make them flat
        some = points[:: len(points) // 10_000]
        if normal_and_depth(some)[1] > 0.01 * np.ptp(some, axis=0).max():
            return None
    extent = np.ptp(points, axis=0)
    if extent.min() <= 1e-6 * extent.max():  # a thinner set of points is a plane
        return np.asarray(np.eye(3)[int(np.argmin(extent))])
    normal, depth = normal_and_depth(points)
    if depth > 1e-6 * extent.max():  # the eigenvalue is lost in rounding
        return None
    return np.asarray(normal * np.sign(normal[int(np.argmax(np.abs(normal)))]))


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def direction_note(reading, axes: np.ndarray) -> list[str]:
    """Return a note if a file's velocity does not run against the optical axis, where the caller gives no axis.

    The ambient density is then that of the air at the wrong end. A velocity along the axis, `axes[2]` in the file's
    axes, is warned of; across it, it may be meant.
    """
    if reading.frame.look is not None or (mean := _mean_velocity(reading.dataset)) is None:
        return []
    name, velocity = mean
    cosine = float(velocity @ axes[2])
    if cosine < -0.5:
        return []
    along = int(np.argmax(np.abs(velocity)))
    said = f"{'-' if velocity[along] < 0.0 else '+'}{'xyz'[along]}"
    note = (
        f"the flow runs along {said} by its {name!r}, which is not against the optical axis: with flow = {said!r} in "
        "the frame it is, and the ambient density is taken upstream"
    )
    if cosine > 0.5:
        warn_caller(f"{reading.path}: {note}")
    return [note]


def _mean_velocity(dataset: Dataset) -> tuple[str, np.ndarray] | None:
    """Return the name and the direction of the mean velocity or momentum; None if none is known."""
    total, speed, called = np.zeros(3), 0.0, ""
    with np.errstate(over="ignore", invalid="ignore"):  # damaged numbers, which are not those of the density
        for block in dataset.blocks:
            velocity = _velocity(block.cell_data) or _velocity(block.point_data)
            if velocity is not None:
                called, own = velocity
                own = own[np.isfinite(own).all(axis=1)]
                total += own.sum(axis=0)
                speed += float(np.linalg.norm(own, axis=1).sum())
        size = float(np.linalg.norm(total))
    # A mean velocity far below the mean speed has no direction, as in a closed room.
    return (called, total / size) if called and 0.3 * speed < size < np.inf else None


def _velocity(arrays: Mapping[str, np.ndarray]) -> tuple[str, np.ndarray] | None:
    """Return a velocity or momentum, shape (n, 3), and its name: a vector, or two or three components."""
    names = {plain_name(name): name for name in reversed([*arrays])}
    try:
        for one in ("u", "velocity", "velocityvector", "umean", "momentum", "rhou"):
            values: np.ndarray = np.asarray(arrays[names[one]]) if one in names else np.empty(0)
            if values.ndim == 2 and values.shape[1] in (2, 3) and values.dtype.kind == "f":
                return names[one], np.pad(values.astype(np.float64), ((0, 0), (0, 3 - values.shape[1])))
    except ReadError:  # a damaged field that the density does not need
        return None
    forms = ("velocity{}", "{}velocity", "vel{}", "momentum{}", "{}momentum", "u{}", "v{}")
    for plain in [tuple(map(form.format, "xyz")) for form in forms] + [("u", "v", "w"), ("rhou", "rhov", "rhow")]:
        parts = [np.asarray(arrays[names[one]]) if one in names else np.empty(0) for one in plain]
        if parts[0].ndim == 1 and len(parts[0]) == len(parts[1]) > 0 and all(own.dtype.kind == "f" for own in parts):
            last = parts[2] if parts[2].shape == parts[0].shape else np.zeros(len(parts[0]))
            return names[plain[0]], np.stack([parts[0], parts[1], last], axis=1, dtype=np.float64)
    return None
