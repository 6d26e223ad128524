r"""Trace many look directions of a pupil through a volume in one launch, and check some of them by full traces.

Along each undisturbed ray, by two Gauss points a cell of the cubic spline,

    OPD = \int m ds + \int (g . xi + theta^2 / 2) ds,   theta = \int g ds,  xi = \int theta ds,  g = grad m across it

plus the contributions of the faces and of the path to the stop: the straight line's optical path, and its change by
bending to second order (see bending.py). Sums over the pupil are formed on the device that traces the rays, the
processor's cores or a GPU. Terms of third order in the contrast are neglected. The direction of the greatest rms and
some others are traced in full as a check. If they differ by more than the tolerance and both sampling errors allow, all
directions are traced in full.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..device_arrays.pinned import to_host
from ..medium import IndexField
from ..process.opened import OPENED
from ..pupils.vectors import transverse_frames
from ..rays import RayBundle
from ..tracing.cuts import lost
from ..tracing.lines import box_span
from ..tracing.pupil.air import GREATEST_SHARE, PAST_TOLD
from .bending import SAFETY
from .snapshot import gpu_of
from .strehl_bound import strehl_error
from .warp_launch import launch

LEAST = 12  # directions; fewer are traced one by one
CHECKED = 3
REPLICATES = 16
AT_ONCE = 1 << 24  # rays of a launch; speed only
KNOWN_RAYS = 256  # rays of a direction for which it is examined what they miss of the flow
KNOWN_FIRST = 16  # rays of the first check of all directions
KNOWN_AT_ONCE = 1 << 18  # speed only
CURVE_BITS = 12  # of the coordinates of points, along each axis; speed only
Look = tuple[dict[str, float], np.ndarray, bool]


def can_batch(field: IndexField, looks: np.ndarray, options: dict[str, Any]) -> bool:
    """Return whether directions can be batched: many of them, through a cubic volume without a body, in float32."""
    if len(looks) < LEAST or not field.is_uniform or field.geometry != "volume" or field.body is not None:
        return False
    if field.interpolation != "cubic":
        return False
    backend, precision = options.get("backend", "auto"), options.get("precision", "float32")
    return backend in ("auto", "warp") and precision == "float32" and set(options["remove"]) <= {"piston", "tilt"}


def batch_looks(
    field: IndexField, pupil: Any, looks: np.ndarray, options: dict[str, Any], wavelength: float, check: Callable
) -> list[Look] | None:
    """Return the result of `check` for all directions; None if the two differ by too much.

    Args:
        field: The refractive index.
        pupil: The pupil, turned to each direction.
        looks: Unit vectors, shape (n, 3).
        options: Of `look_map`: ray_count, tolerance, remove, backend, device.
        wavelength: Vacuum wavelength [m].
        check: Function that returns the numbers of one direction, its tilt in space and whether it meets the flow, by
            full traces.
    """
    axes = transverse_frames(looks)
    tolerance = float(options["tolerance"])
    per_replicate = max(1, -(-int(options["ray_count"]) // REPLICATES))
    ahead = replace(pupil, normal=np.array([0.0, 0.0, 1.0]))
    samples = [ahead.sample(per_replicate, "sobol", seed)[0] - ahead.center for seed in range(REPLICATES)]
    points = np.concatenate([side_by_side(one @ np.stack(ahead.axes, axis=1)) for one in samples])
    device = gpu_of(options.get("backend"), options.get("device")) or "cpu"
    traced = _Traced(field, pupil, points, per_replicate, wavelength, options["remove"], device)
    each = max(1, AT_ONCE // len(points))  # speed only
    parts = [traced(looks[k : k + each], axes[k : k + each]) for k in range(0, len(looks), each)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    met = found.pop("met")
    if not met.any():
        return None
    known = _known(field, pupil.center, points[:: -(-len(points) // KNOWN_RAYS)], looks, axes, tolerance * wavelength)
    numbers = [
        {
            "strehl": float(found["strehl"][k]),
            "strehl_standard_error": float(found["standard_error"][k]),
            "opd_rms": float(found["rms"][k]),
            "blocked": 0.0,
            "known": float(known[k]),
        }
        for k in range(len(looks))
    ]
    tilts = np.einsum("na,nak->nk", found["tilt"], axes)
    order = np.argsort(found["rms"])[::-1]
    for k in order[np.unique(np.linspace(0, np.count_nonzero(met) - 1, CHECKED).astype(int))]:
        if not _agrees(numbers[k], check(looks[k])[0], len(points), tolerance, wavelength):
            return None
    return [(one, tilt, bool(seen)) for one, tilt, seen in zip(numbers, tilts, met, strict=True)]


def _agrees(
    ours: dict[str, float], full: dict[str, float], ray_count: int, tolerance: float, wavelength: float
) -> bool:
    """Return whether a direction's numbers agree with its full trace within the tolerance and the sampling error."""
    if not np.isfinite(full["strehl"]) or full["blocked"] > 0.0:
        return False
    sampling = SAFETY * float(np.hypot(ours["strehl_standard_error"], full["strehl_standard_error"]))
    allowed = strehl_error(full["strehl"], 2.0 * np.pi * tolerance) + sampling
    rms = tolerance * wavelength + SAFETY * full["opd_rms"] / np.sqrt(ray_count)
    return abs(ours["strehl"] - full["strehl"]) <= allowed and abs(ours["opd_rms"] - full["opd_rms"]) <= rms


def side_by_side(points: np.ndarray) -> np.ndarray:
    """Sort points of a plane, shape (n, 2), along a Z-order curve, so that consecutive points are close together.

    Rays that are traced together then read the same samples.
    """
    span = np.ptp(points, axis=0).max() or 1.0
    place = ((points - points.min(axis=0)) / span * ((1 << CURVE_BITS) - 1)).astype(np.int64)
    order = np.zeros(len(points), np.int64)
    for bit in range(CURVE_BITS):
        order |= ((place[:, 0] >> bit & 1) << (2 * bit)) | ((place[:, 1] >> bit & 1) << (2 * bit + 1))
    return points[np.argsort(order, kind="stable")]


def _known(field: IndexField, center: np.ndarray, points: np.ndarray, looks, axes, tolerance: float) -> np.ndarray:
    """Return whether the rays of each direction miss nothing: by cuts a thousandth of the points, past the box more."""
    found = np.ones(len(looks))
    most, most_past = GREATEST_SHARE * len(points), PAST_TOLD * len(points)
    # A few points suffice to find most directions that miss something; the others are checked with all points.
    for some in (points[:: -(-len(points) // KNOWN_FIRST)], points):
        left = np.flatnonzero(found)
        each = max(1, KNOWN_AT_ONCE // len(some))  # speed only
        for rows in (left[first : first + each] for first in range(0, len(left), each)):
            position = (center + np.einsum("pa,nak->npk", some, axes[rows])).reshape(-1, 3)
            direction = np.repeat(looks[rows], len(some), axis=0)
            amount = lost(field, RayBundle(position, direction), None, tolerance=tolerance).reshape(-1, len(some))
            past = ~box_span(field, position, direction).meets.reshape(-1, len(some))
            found[rows] = (np.abs(amount) > tolerance).sum(axis=1) <= most
            found[rows] *= (past.sum(axis=1) <= most_past) | past.all(axis=1)
    return found


class _Traced:
    """Rays of some directions, traced and summed on a device."""

    def __init__(self, field, pupil, points: np.ndarray, per_replicate: int, wavelength: float, remove, device: str):
        """Copy the field and the points of the pupil to the device."""
        import warp as wp

        from ..process.quiet_warp import open_device
        from .look_kernels import build_kernels

        open_device(device)
        self.device, self.remove, self.each, self.points = device, remove, per_replicate, points
        self.wavenumber = 2.0 * np.pi / wavelength
        self.kernels = OPENED.once("kernels of look maps", build_kernels)
        grid = field.samples
        flat = np.ascontiguousarray(grid.coefficients, dtype=np.float32).reshape(-1)
        corners = np.array(np.meshgrid(*zip(grid.low, grid.high, strict=True))).reshape(3, -1).T
        self.corners = corners - pupil.center
        self.before = [
            wp.array(flat, dtype=float, device=device),
            wp.vec3i(*map(int, grid.shape)),
            wp.vec3(*((pupil.center - grid.origin) / grid.spacing)),
            wp.vec3(*(1.0 / grid.spacing)),
            float(field.ambient_index),
            wp.array(points.astype(np.float32), dtype=wp.vec2, device=device),
        ]

    def __call__(self, looks: np.ndarray, axes: np.ndarray) -> dict[str, np.ndarray]:
        """Return the Strehl ratios, rms and tilts of some directions, and whether they meet the flow."""
        import warp as wp

        device, total, some = self.device, len(self.points), len(looks)
        reach = np.maximum((looks @ self.corners.T).max(axis=1), 0.0)

        def put(array: np.ndarray, kind: Any) -> Any:
            return wp.array(np.ascontiguousarray(array), dtype=kind, device=device)

        rays, moments, phasors = self.kernels
        opd = wp.empty(some * total, dtype=float, device=device)
        way = [put(one.astype(np.float32), wp.vec3) for one in (looks, axes[:, 0], axes[:, 1])]
        launch(rays, some * total, [*self.before, *way, put(reach.astype(np.float32), float)], [opd], device)
        groups = total // self.each
        sums = wp.empty(some * groups, dtype=wp.vec4d, device=device)
        launch(moments, some * groups, [opd, self.before[-1], self.each], [sums], device)
        moment = to_host(sums).reshape(some, groups, 4).sum(axis=1) / total
        basis = np.c_[np.ones(total), self.points.astype(np.float32)]
        plane = moment[:, [0, 2, 3]] @ np.linalg.pinv(basis.T @ basis / total)
        removed = np.zeros((some, 3))
        if "piston" in self.remove:
            removed[:, 0] = moment[:, 0]
        if "tilt" in self.remove:
            removed = plane if "piston" in self.remove else np.c_[np.zeros(some), plane[:, 1:]]
        turned = wp.empty(some * groups, dtype=wp.vec2d, device=device)
        given = [opd, self.before[-1], self.each, groups, put(removed, wp.vec3d), self.wavenumber]
        launch(phasors, some * groups, given, [turned], device)
        found = to_host(turned).reshape(some, groups, 2) / self.each
        ratio = (found**2).sum(axis=2)
        square = basis.T @ basis / total
        left = moment[:, 1] - 2.0 * np.einsum("nk,nk->n", removed, moment[:, [0, 2, 3]])
        left += np.einsum("nk,kl,nl->n", removed, square, removed)
        return {
            "strehl": (found.mean(axis=1) ** 2).sum(axis=1),
            "standard_error": ratio.std(axis=1, ddof=1) / np.sqrt(groups),
            "rms": np.sqrt(np.maximum(left, 0.0)),
            "tilt": plane[:, 1:],
            "met": moment[:, 1] > 0.0,
        }
