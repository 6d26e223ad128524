"""Vectors: checks of those that callers give, and frames, lengths and directions."""

from typing import Any

import numpy as np

from ..inputs.kinds import are_numbers


def as_vector(value, name: str) -> np.ndarray:
    """Return `value` as a finite float64 vector of shape (3,), a read-only copy: callers may reuse their array.

    Raises:
        TypeError: It does not consist of numbers.
        ValueError: It is not three finite numbers.
    """
    if not are_numbers(value):
        raise TypeError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    vector.setflags(write=False)
    return vector


def as_unit_vector(value, name: str) -> np.ndarray:
    """Return `value` normalised to length 1, read-only, shape (3,).

    Raises:
        TypeError: As for `as_vector`.
        ValueError: As for `as_vector`, or the zero vector.
    """
    vector = as_vector(value, name)
    greatest = np.abs(vector).max()
    if greatest == 0.0:
        raise ValueError(f"{name} must not be the zero vector")
    # Scaled first, because the squared length of a very long or short vector would overflow or underflow.
    vector = vector / greatest
    vector /= np.linalg.norm(vector)
    vector.setflags(write=False)
    return vector


def transverse_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors that complete `normal` to a right-handed frame; x and y if `normal` is +z."""
    helper = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = _cross(helper, normal)
    first /= np.linalg.norm(first)
    return first, _cross(normal, first)


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the cross product of two vectors (3,), in a tenth of the time of `np.cross`."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def transverse_frames(normals: np.ndarray) -> np.ndarray:
    """Return the two vectors of `transverse_axes` for each unit vector (n, 3), shape (n, 2, 3)."""
    helper = np.where(np.abs(normals[:, 1:2]) < 0.9, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    first = np.cross(helper, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=1)


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors (n, 3), shape (n,), in a fifth of the time of `np.linalg.norm`."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def direction_of(azimuth: Any, elevation: Any) -> np.ndarray:
    """Return look directions, shape (..., 3), of azimuths toward +x and elevations toward +y [rad]; 0, 0 is +z."""
    flat = np.cos(elevation)
    return np.stack(np.broadcast_arrays(np.sin(azimuth) * flat, np.sin(elevation), np.cos(azimuth) * flat), axis=-1)
