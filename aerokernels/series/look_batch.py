r"""Many look directions of a pupil: traced through a volume in one launch, and the errors of a few told to all.

Along each undisturbed ray, by two Gauss points a cell of the cubic spline,

    OPD = \int m ds + \int (g . xi + theta^2 / 2) ds,   theta = \int g ds,  xi = \int theta ds,  g = grad m across it

plus the contributions of the faces and of the path to the stop: the straight line's optical path, and its change by
bending to second order (see bending.py). Sums over the pupil are formed on the device that traces the rays, the
processor's cores or a GPU. Terms of third order in the contrast are neglected. Some rays of the directions whose errors
are computed are traced in full. If these differ by more than the tolerance, all directions are traced.

Errors are computed for a few directions, of which each other one takes the nearest's. The few are spread over the map:
the strongest first, and then whichever is farthest from all before it. Distance is that of the directions, as unit
vectors, and of the decimal logarithms of the OPD rms, so that a direction through strong air does not take the errors
of one beside it. The sampling errors are each direction's own.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.device_arrays.pinned import to_host
from aerokernels.medium import IndexField
from aerokernels.process.opened import OPENED
from aerokernels.pupils.base import transverse_frames
from aerokernels.rays import RayBundle
from aerokernels.series.kernels import launch
from aerokernels.series.map_errors import straight_variants
from aerokernels.series.snapshot import gpu_of
from aerokernels.strehl.budget import sampling_of
from aerokernels.tracing import Plane
from aerokernels.tracing.cuts import lost
from aerokernels.tracing.lines import box_span
from aerokernels.tracing.pupil.air import GREATEST_SHARE, PAST_TOLD
from aerokernels.tracing.variants.causes import Variants, errors, sample_rows
from aerokernels.wavefront.terms import PupilNumbers

REPLICATES = 16


@dataclass(eq=False)
class Look:
    """What is known of a direction.

    Attributes:
        numbers: "strehl", "strehl_standard_error", "opd_rms" [m], "blocked" and "known".
        axes: The pupil's two axes, shape (2, 3).
        tilt: The beam's deflection along them [rad], shape (2,).
        met: Whether the pupil looks through the flow.
        sampling: Errors of PupilNumbers' numbers by the number of rays, shape (5,).
        model: Computes those by all other causes, shape (5,); None where there are none.
    """

    numbers: dict[str, float]
    axes: np.ndarray
    tilt: np.ndarray
    met: bool
    sampling: np.ndarray
    model: Callable[[], np.ndarray] | None = None

    @property
    def in_space(self) -> np.ndarray:
        """The deflection in space [rad], shape (3,)."""
        return np.asarray(self.tilt @ self.axes)


def numbers_of(strehl: float, standard_error: float, rms: float, blocked: float, known: float) -> dict[str, float]:
    """Return the numbers of a direction, without their errors."""
    names = "strehl", "strehl_standard_error", "opd_rms", "blocked", "known"
    return dict(zip(names, (strehl, standard_error, rms, blocked, known), strict=True))


def few_of(looks: np.ndarray, rms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of a few directions, and for each direction which of these is the nearest, shape (n,).

    Args:
        looks: Unit vectors, shape (n, 3).
        rms: Their OPD rms [m], shape (n,).
    """
    level = np.log10(np.maximum(rms, 1e-4 * rms.max(initial=0.0) + 1e-300))
    place = np.column_stack([looks, level])
    rows = [int(np.argmax(rms))]
    apart = [np.linalg.norm(place - place[rows[0]], axis=1)]
    while len(rows) < 8 and np.min(apart, axis=0).max() > 0.0:
        rows.append(int(np.argmax(np.min(apart, axis=0))))
        apart.append(np.linalg.norm(place - place[rows[-1]], axis=1))
    return np.array(rows), np.argmin(apart, axis=0)


def tell_errors(found: list[Look], looks: np.ndarray) -> np.ndarray:
    """Add "strehl_error" and "opd_rms_error" to directions' numbers; return errors of their tilts.

    Returns:
        Vectors in space along both of each pupil's axes, of the errors' lengths [rad], shape (n, 2, 3).
    """
    rows = np.array([k for k, one in enumerate(found) if one.model is not None], int)
    model = np.zeros((len(found), len(found[0].sampling)))
    axes = np.stack([one.axes for one in found])
    along = axes.copy()
    if len(rows):
        few, nearest = few_of(looks[rows], np.array([found[k].numbers["opd_rms"] for k in rows]))
        computed = np.stack([found[k].model() for k in rows[few]])
        model[rows] = computed[nearest]
        along[rows] = axes[rows[few]][nearest]
    total = np.hypot(model, np.stack([one.sampling for one in found]))
    for one, error in zip(found, total, strict=True):  # in the order of wavefront/pupil_numbers.py
        one.numbers |= {"strehl_error": float(error[0]), "opd_rms_error": float(error[2])}
    # Another direction's axes, as they lie across this one.
    normal = np.cross(axes[:, 0], axes[:, 1])
    along -= np.einsum("nak,nk->na", along, normal)[..., None] * normal[:, None]
    return np.asarray(along * total[:, 3:5, None])


def can_batch(field: IndexField, looks: np.ndarray, options: dict[str, Any]) -> bool:
    """Return whether directions can be batched: many of them, through a cubic volume without a body, in float32."""
    if len(looks) < 12 or not field.is_uniform or field.geometry != "volume" or field.body is not None:
        return False
    if field.interpolation != "cubic":
        return False
    backend, precision = options.get("backend", "auto"), options.get("precision", "float32")
    return backend in ("auto", "warp") and precision == "float32" and set(options["remove"]) <= {"piston", "tilt"}


def batch_looks(
    field: IndexField, pupil: Any, looks: np.ndarray, options: dict[str, Any], wavelength: float
) -> list[Look] | None:
    """Return what is known of all directions; None if traced rays differ by too much.

    Args:
        field: The refractive index.
        pupil: The pupil, turned to each direction.
        looks: Unit vectors, shape (n, 3).
        options: Of `look_map`: ray_count, tolerance, remove, backend, device.
        wavelength: Vacuum wavelength [m].
    """
    axes = transverse_frames(looks)
    tolerance = float(options["tolerance"])
    per_replicate = max(1, -(-int(options["ray_count"]) // REPLICATES))
    ahead = replace(pupil, normal=np.array([0.0, 0.0, 1.0]))
    samples = [ahead.sample(per_replicate, "sobol", seed)[0] - ahead.center for seed in range(REPLICATES)]
    points = np.concatenate(samples) @ np.stack(ahead.axes, axis=1)
    device = gpu_of(options.get("backend"), options.get("device")) or "cpu"
    traced = _Traced(field, pupil, points, per_replicate, wavelength, options["remove"], device)
    each = max(1, (1 << 24) // len(points))  # speed only
    parts = [traced(looks[k : k + each], axes[k : k + each]) for k in range(0, len(looks), each)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if not found["met"].any():
        return None
    known = _known(field, pupil.center, points[:: -(-len(points) // 256)], looks, axes, tolerance * wavelength)
    given = []
    for k, met in enumerate(found["met"]):
        strehl, standard_error, rms = (float(found[name][k]) for name in ("strehl", "standard_error", "rms"))
        sampling = sampling_of(standard_error, found["fits"][k], wavelength)
        rays = _Model(traced, looks[k], axes[k], options) if met else None
        numbers = numbers_of(strehl, standard_error, rms, 0.0, float(known[k]))
        given.append(Look(numbers, axes[k], found["tilt"][k], bool(met), sampling, rays))
    rows = np.flatnonzero(found["met"])
    few, _ = few_of(looks[rows], found["rms"][rows])
    agree = all(given[k].model.agrees for k in rows[few])
    return given if agree else None


class _Model:
    """Computes the errors of a direction by all causes but the sampling, on some of its rays."""

    def __init__(self, traced: "_Traced", look: np.ndarray, axes: np.ndarray, options: dict[str, Any]):
        """Take a unit vector, the two axes across it, and the options of `look_map`."""
        self._traced, self._look, self._axes, self._options = traced, look, axes, options

    @cached_property
    def found(self) -> Variants:
        """Some of the rays, and how they change by each cause."""
        traced = self._traced
        position = traced.center + traced.points @ self._axes
        rays = RayBundle(position, np.broadcast_to(self._look, position.shape))
        rows = sample_rows(traced.field, rays, np.ones(len(position), bool))
        self._points = traced.points[rows]
        opd, reach = traced.opd(self._look[None], self._axes[None])
        until = Plane(traced.center + reach[0] * self._look, self._look)
        given = to_host(opd)[rows], until, traced.wavelength, self._options["tolerance"], self._options
        return straight_variants(traced.field, rays.rows(rows), *given)

    @property
    def agrees(self) -> bool:
        """Whether traced rays have the same optical path within the tolerance, rms about the mean."""
        (off,) = self.found.causes["step"].known
        return bool(np.std(off.opd) <= self._options["tolerance"] * self._traced.wavelength)

    def __call__(self) -> np.ndarray:
        """Return the errors of PupilNumbers' numbers, shape (5,)."""
        found = self.found
        remove = tuple(self._options["remove"])
        number = PupilNumbers(self._points, found.weight, self._traced.wavelength, remove)
        return np.sqrt(np.sum(np.square(list(errors(number, found).values())), axis=0))


def _known(field: IndexField, center: np.ndarray, points: np.ndarray, looks, axes, tolerance: float) -> np.ndarray:
    """Return whether the rays of each direction miss nothing: by cuts a thousandth of the points, past the box more."""
    found = np.ones(len(looks))
    most, most_past = GREATEST_SHARE * len(points), PAST_TOLD * len(points)
    # A few points suffice to find most directions that miss something; the others are checked with all points.
    for some in (points[:: -(-len(points) // 16)], points):
        left = np.flatnonzero(found)
        each = max(1, (1 << 18) // len(some))  # speed only
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
        from .kernels import look_kernels

        open_device(device)
        self.device, self.remove, self.each, self.points = device, remove, per_replicate, points
        self.field, self.center, self.wavelength = field, pupil.center, wavelength
        self.wavenumber = 2.0 * np.pi / wavelength
        self.kernels = OPENED.once("kernels of look maps", look_kernels)
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

    def opd(self, looks: np.ndarray, axes: np.ndarray) -> tuple[Any, np.ndarray]:
        """Return the optical path differences of all rays [m], on the device, and the distances of their stops [m]."""
        import warp as wp

        reach = np.maximum((looks @ self.corners.T).max(axis=1), 0.0)
        count = len(looks) * len(self.points)
        found = wp.empty(count, dtype=float, device=self.device)
        way = [self._put(one.astype(np.float32), wp.vec3) for one in (looks, axes[:, 0], axes[:, 1])]
        given = [*self.before, *way, self._put(reach.astype(np.float32), float)]
        launch(self.kernels[0], count, given, [found], self.device)
        return found, reach

    def _put(self, array: np.ndarray, kind: Any) -> Any:
        import warp as wp

        return wp.array(np.ascontiguousarray(array), dtype=kind, device=self.device)

    def __call__(self, looks: np.ndarray, axes: np.ndarray) -> dict[str, np.ndarray]:
        """Return the numbers of some directions, each replicate's rms and tilt, and whether they meet the flow."""
        import warp as wp

        device, total, some = self.device, len(self.points), len(looks)
        _, moments, phasors = self.kernels
        opd, _ = self.opd(looks, axes)
        groups = total // self.each
        sums = wp.empty(some * groups, dtype=wp.vec4d, device=device)
        launch(moments, some * groups, [opd, self.before[-1], self.each], [sums], device)
        by_group = to_host(sums).reshape(some, groups, 4) / self.each
        moment = by_group.mean(axis=1)
        basis = np.c_[np.ones(total), self.points.astype(np.float32)]
        square = basis.T @ basis / total
        plane = moment[:, [0, 2, 3]] @ np.linalg.pinv(square)
        removed = np.zeros((some, 3))
        if "piston" in self.remove:
            removed[:, 0] = moment[:, 0]
        if "tilt" in self.remove:
            removed = plane if "piston" in self.remove else np.c_[np.zeros(some), plane[:, 1:]]
        turned = wp.empty(some * groups, dtype=wp.vec2d, device=device)
        given = [opd, self.before[-1], self.each, groups, self._put(removed, wp.vec3d), self.wavenumber]
        launch(phasors, some * groups, given, [turned], device)
        found = to_host(turned).reshape(some, groups, 2) / self.each
        ratio = (found**2).sum(axis=2)
        apart = basis.reshape(groups, self.each, 3)
        squares = np.einsum("gek,gel->gkl", apart, apart) / self.each
        planes = np.einsum("ngk,gkl->ngl", by_group[..., [0, 2, 3]], np.linalg.pinv(squares))
        piston, tilt = "piston" in self.remove, "tilt" in self.remove
        about = planes if tilt else np.concatenate([by_group[..., :1], np.zeros((some, groups, 2))], axis=2)
        about = about * np.array([piston, tilt, tilt])
        each_rms = np.sqrt(_mean_square(by_group, about, squares))
        return {
            "strehl": (found.mean(axis=1) ** 2).sum(axis=1),
            "standard_error": ratio.std(axis=1, ddof=1) / np.sqrt(groups),
            "rms": np.sqrt(_mean_square(moment, removed, square)),
            "tilt": plane[:, 1:],
            "fits": np.concatenate([each_rms[..., None], planes[..., 1:]], axis=2),
            "met": moment[:, 1] > 0.0,
        }


def _mean_square(moment: np.ndarray, removed: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Return the mean square of an OPD less a plane [m2], from its moments (.., 4) and those of the plane's basis."""
    left = moment[..., 1] - 2.0 * np.sum(removed * moment[..., [0, 2, 3]], axis=-1)
    return np.maximum(left + np.einsum("...k,...kl,...l->...", removed, square, removed), 0.0)
