r"""The optical path differences of a snapshot: from straight lines where those are accurate enough, else traced.

On straight rays OPD = K \int (rho - rho_ambient) ds is linear in the density (Gladstone-Dale), so a snapshot costs one
pass over its samples. The neglected bending and displacement of the rays are measured by full traces of some rays. They
grow with the square of the slopes of the wavefront, -1/2 \int theta^2 ds, so they are measured again whenever the
slopes have grown. Where they are above the tolerance the snapshot is traced in full.

Errors are the numbers of some rays, computed again as each cause changes these, of a few snapshots, evenly spread, and
of those whose wavefront is much steeper or flatter than before. Each other one takes those of the nearest in time.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from aerokernels.display.quantities import combine
from aerokernels.flow import DensityField, Series, refractivity_model
from aerokernels.flow.gas import GREATEST_DENSITY, LEAST_DENSITY
from aerokernels.inputs.kinds import refuse_half_precision
from aerokernels.medium import IndexField, QuadMesh
from aerokernels.medium.refined import has_seam
from aerokernels.rays import Pupil, RayBundle
from aerokernels.series.line_integrals import LineIntegrals, MeshIntegrals, NotLinearError
from aerokernels.series.pupil_grid import MapReader, PupilGrid
from aerokernels.tracing import Plane, TraceResult
from aerokernels.tracing.cuts import lost
from aerokernels.tracing.engines.choice import choose_backend
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.pupil.air import PupilAir, pupil_air
from aerokernels.tracing.step_bound import step_allowance
from aerokernels.tracing.stop import plane_beyond, stop_distance
from aerokernels.tracing.trace import trace
from aerokernels.tracing.variants.causes import Variants, errors, few_rows, of_a_ray, sample_size, variants
from aerokernels.tracing.variants.paths import Rays
from aerokernels.wavefronts import remove_terms

METHODS = ("auto", "linear", "trace")
GROWN = 1.5  # growth of the squared slopes after which the bending is measured again
PROBE_TOLERANCE = 0.1  # of the tolerance


@dataclass(frozen=True)
class SnapshotSettings:
    """Direction, relation and method of the rays of a series, as `optical_series` takes them."""

    direction: np.ndarray  # a unit vector, shape (3,)
    wavelength: float
    relation: str | None
    constant: float | None
    composition: Any
    interpolation: str | None  # None: that of the flow's kind
    tolerance: float
    method: str
    trace_options: dict[str, Any]  # backend, device and precision

    def index_field(self, flow: DensityField) -> IndexField:
        """Return the index field of a snapshot."""
        options: dict[str, Any] = {"constant": self.constant, "composition": self.composition}
        if self.interpolation is not None:
            options["interpolation"] = self.interpolation
        return flow.index_field(self.wavelength, self.relation, **options)


@dataclass(frozen=True, eq=False)
class SnapshotResult:
    """The optical path differences of a snapshot."""

    opd: np.ndarray  # [m], shape (n,); NaN where a ray failed
    valid: np.ndarray  # whether a ray came through, its whole path in the grid, shape (n,)
    traced: bool
    slope: float  # mean square of the wavefront's slopes
    varied: Callable[[], Variants | None]  # how some rays change by each cause of an error; None where none arrived
    probe: float = np.nan  # the bending's part, terms removed [m]; NaN where it was not measured here


class Snapshots:
    """Converts the snapshots of a series to optical path differences, one after another, in their order.

    Attributes:
        reason: Why snapshots are traced in full, or "" where straight lines may suffice.
    """

    def __init__(self, series: Series, grid: PupilGrid, settings: SnapshotSettings, remove: tuple[str, ...]):
        """Prepare the geometry."""
        self.series, self.grid, self.settings, self.remove = series, grid, settings, remove
        self.model = refractivity_model(settings.relation, constant=settings.constant, composition=settings.composition)
        self.lines: LineIntegrals | MeshIntegrals | None = None
        self.reason = ""
        if (device := settings.trace_options.get("device")) is not None:  # refused also where nothing is traced
            choose_backend(settings.trace_options.get("backend") or "auto", device)
        self._measured_slope, self._measured = 0.0, np.nan
        try:
            lines = self._lines()
            if settings.method == "auto" and not lines.inside.all():
                raise NotLinearError("rays that leave the grid by a side, or miss it, are traced")
            self.lines = lines
        except NotLinearError as fault:
            if settings.method == "linear":
                raise ValueError(f"method 'linear' cannot be had: {fault}; take 'auto'") from None
            self.reason = str(fault)

    def _lines(self) -> LineIntegrals | MeshIntegrals:
        if self.settings.method == "trace":
            raise NotLinearError("method 'trace' was requested")
        mesh = self.series.mesh
        if mesh is None:
            raise NotLinearError("snapshots of formulas are traced, those of samples on one mesh are not")
        if self.series.body is not None:
            raise NotLinearError("rays past a body are traced")
        if self.model.composition is not None:
            raise NotLinearError("a composition of species is traced")
        if isinstance(mesh, QuadMesh):
            if self.settings.interpolation not in (None, "conserving", "bilinear"):
                raise NotLinearError(f"interpolation {self.settings.interpolation!r} of a mesh is traced")
            if self.settings.interpolation == "conserving" and has_seam(mesh):
                raise NotLinearError("a mesh that closes on itself in a seam is not cut")
            return MeshIntegrals(mesh, self.grid.points, self.settings.direction, self.settings.interpolation)
        interpolation = self.settings.interpolation or "cubic"
        return LineIntegrals(mesh, self.grid.points, self.settings.direction, interpolation)

    def resume(self, slope: float, probe: float) -> None:
        """Restore the measurement of an interrupted run."""
        if np.isfinite(probe):
            self._measured_slope, self._measured = slope, probe

    def air(self, pupil: Pupil, number: int, stored: Any) -> PupilAir:
        """Return what the pupil misses of a snapshot."""
        field = self.settings.index_field(self.series.field(stored, number))
        return pupil_air(field, pupil, self.settings.direction, self.settings.tolerance * self.settings.wavelength)

    def __call__(self, number: int, stored: Any) -> SnapshotResult:
        """Return the optical path differences of a snapshot, as `Series.read` returned it."""
        flow = stored if isinstance(stored, DensityField) else None
        mixture = getattr(flow, "composition", None) is not None and self.settings.constant is None
        if self.lines is None or mixture or (flow is not None and not self.series.lies_here(flow)):
            return self._traced(self.settings.index_field(self.series.field(stored, number)))
        density = np.asarray(stored if flow is None else flow.density)  # type: ignore[attr-defined]
        refuse_half_precision(density, f"the density of snapshot {number}")
        ambient = self.series.ambient_density if flow is None else flow.ambient_density
        assert ambient is not None  # open_series requires it
        if flow is None:
            self._check_range(density, number)
        opd = self._straight(density, ambient)
        valid = self.lines.inside & np.isfinite(opd)
        if not np.isfinite(opd).all():
            bad = int((~np.isfinite(density)).sum())
            raise ValueError(f"snapshot {number}: {bad} of {density.size} densities are not finite; repair the file")
        slope = self._slope(opd, valid)
        probe, rows = np.nan, None
        if self.settings.method == "auto" and not (
            np.isfinite(self._measured) and slope <= GROWN * self._measured_slope + 1e-30
        ):
            rows = self._sample(valid)
            few = rows[few_rows(len(rows))]
            bent = self._bent(stored, number, few)
            probe = self._rms(bent - opd[few], few)
            self.resume(slope, probe)
        grown = max(1.0, slope / self._measured_slope) if self._measured_slope > 0.0 else 1.0
        tolerance = self.settings.tolerance * self.settings.wavelength
        if self.settings.method == "auto" and self._measured * grown > tolerance:
            result = self._traced(self.settings.index_field(self.series.field(stored, number)))
            return replace(result, slope=slope, probe=probe)
        varied = partial(self._varied, stored, number, opd, valid, rows)
        return SnapshotResult(opd, valid, False, slope, varied, probe)

    def errors(self, result: SnapshotResult) -> dict[str, float]:
        """Return the errors of a snapshot's numbers and of its optical path differences, without that of the pixels."""
        varied = result.varied()
        axes = np.linalg.pinv(np.stack(self.grid.aperture.axes))
        points = np.empty((0, 2)) if varied is None else (varied.start - self.grid.pupil.center) @ axes
        return map_errors(varied, points, self.settings.wavelength, self.remove)

    def _check_range(self, samples: np.ndarray, number: int) -> None:
        """Reject densities that no gas has, for which straight lines would give a number as well.

        Fields have checked theirs.
        """
        if samples.size and not (samples.min() >= LEAST_DENSITY and samples.max() <= GREATEST_DENSITY):
            try:
                self.series.field(samples, number)
            except ValueError as fault:
                raise ValueError(f"snapshot {number}: {fault}") from None

    def _straight(self, density: np.ndarray, ambient: float) -> np.ndarray:
        """Return K times the integral of the density minus the ambient one, whose spline is that constant."""
        assert self.lines is not None
        if self.model.form == "gladstone-dale":
            constant = float(self.model.constant(self.settings.wavelength))
            return constant * self.lines(density, ambient)
        return self.lines(self.model.contrast(density, ambient, self.settings.wavelength))

    def _slope(self, opd: np.ndarray, valid: np.ndarray) -> float:
        """Return the mean square of the slopes of a wavefront, from neighbouring pixels."""
        result = self.grid.spread(np.where(valid, opd, np.nan))
        pixel = float(self.grid.x[1] - self.grid.x[0]) if len(self.grid.x) > 1 else 1.0
        squares = [np.diff(result, axis=axis) ** 2 for axis in (0, 1)]
        means = [float(np.nanmean(one)) if np.isfinite(one).any() else 0.0 for one in squares]
        return sum(means) / pixel**2

    def _rays(self, chosen: np.ndarray | slice) -> RayBundle:
        points = self.grid.points[chosen]
        return RayBundle(points, np.broadcast_to(self.settings.direction, points.shape))

    def _sample(self, valid: np.ndarray) -> np.ndarray:
        """Return rows of some of the rays that came through: those nearest to the rays of a Strehl ratio's error."""
        from scipy.spatial import cKDTree

        assert self.lines is not None
        rows = np.flatnonzero(valid)
        if not len(rows):
            return rows
        count = sample_size(self.lines.mesh)
        wanted = RayBundle.collimated(self.grid.pupil, count, direction=self.settings.direction).position
        apart, nearest = cKDTree(self.grid.points[rows]).query(wanted)
        there = apart <= self.grid.pixel
        return rows[nearest[there if there.any() else slice(None)]]

    def _varied(self, stored: Any, number: int, opd: np.ndarray, valid: np.ndarray, rows: Any) -> Variants | None:
        """Return how some rays on straight lines, those of `rows` if known, change by each cause; None without any."""
        if not valid.any():
            return None
        rows = self._sample(valid) if rows is None else rows
        field, rays = self.settings.index_field(self.series.field(stored, number)), self._rays(rows)
        until = plane_beyond(field, self.grid.pupil, self.settings.direction)

        wavelength, tolerance = self.settings.wavelength, self.settings.tolerance
        return straight_variants(field, rays, opd[rows], until, wavelength, tolerance, self.settings.trace_options)

    def _bent(self, stored: Any, number: int, rows: np.ndarray) -> np.ndarray:
        """Return the optical path differences of some rays, which may bend [m]; NaN where a ray failed."""
        field = self.settings.index_field(self.series.field(stored, number))
        return self._opd(field, self._rays(rows), PROBE_TOLERANCE)[0]

    def _opd(self, field: IndexField, rays: RayBundle, share: float = 1.0) -> tuple[np.ndarray, TraceResult]:
        """Trace rays to a share of the tolerance: their optical path differences [m], NaN where a ray failed."""
        traced = trace(
            field,
            rays,
            until=plane_beyond(field, self.grid.pupil, self.settings.direction),
            tolerance=share * self.settings.tolerance,
            wavelength=self.settings.wavelength,
            outputs=("opd",),
            **self.settings.trace_options,
        )
        assert traced.opd is not None
        return np.where(traced.ok, traced.opd, np.nan), traced

    def _rms(self, values: np.ndarray, rows: np.ndarray) -> float:
        """Return the root mean square over those of some rays that came through, terms removed [m]; inf without any."""
        good = np.isfinite(values)
        if not good.any():
            return np.inf if len(rows) else 0.0
        left = remove_terms(values[good], self.remove, self.grid.coordinates[rows[good]])
        return float(np.sqrt(np.mean(left**2)))

    def _traced(self, field: IndexField) -> SnapshotResult:
        rays = replace(self._rays(slice(None)), weight=self.grid.weight[self.grid.lit])
        opd, traced = self._opd(field, rays)
        reached = np.isfinite(opd)
        return SnapshotResult(opd, reached, True, self._slope(opd, reached), lambda: traced.variants)


# The numbers, in order; and with the optical path difference of a ray, what has an error.
NAMES = ("strehl", "boresight_x", "boresight_y", "piston", "opd_rms", "opd_rms_with_tilt")
WRONG = (*NAMES, "error")
LEAST_STEP = 128


def map_errors(
    result: Variants | None, points: np.ndarray, wavelength: float, remove: tuple[str, ...]
) -> dict[str, float]:
    """Return the errors of WRONG, by some rays at `points` across the look direction [m]; NaN where none is known."""
    if result is None:
        return dict.fromkeys(WRONG, float("nan"))
    reader = MapReader(points, result.weight, remove, wavelength)
    by_cause = errors(lambda rays: reader(rays.opd).numbers, result)
    totals = [combine({cause: error[k] for cause, error in by_cause.items()})["total"] for k in range(len(NAMES))]
    of_opd = of_a_ray(lambda rays: reader(rays.opd).opd, result)["total"]
    return {**dict(zip(NAMES, totals, strict=True)), "error": of_opd}


class Chosen:
    """Says of one snapshot after another whether errors are computed for it: of 8 places at most, and of 8 others.

    Places are LEAST_STEP or more apart, so that errors take little of the time.
    """

    def __init__(self, total: int):
        """Begin with the first snapshot of `total`."""
        self._step = LEAST_STEP
        while self._step * 8 < total:
            self._step *= 2
        self._number, self._more, self._slope = 0, 0, np.nan

    def __call__(self, slope: float) -> bool:
        """Whether the next snapshot is one of them; `slope` is the mean square of its wavefront's slopes."""
        other = self._number > 0 and not self._slope / 3.0 <= slope <= self._slope * 3.0
        other = other and self._more < 8
        if other or self._number == 0:
            self._slope = slope
        self._more += other
        self._number += 1
        return bool((self._number - 1) % self._step == 0 or other)


def nearest_in_time(errors: np.ndarray) -> np.ndarray:
    """Return errors of all snapshots, shape (n,), from those that were computed; the others are NaN."""
    known = np.flatnonzero(np.isfinite(errors))
    if not len(known):
        return np.full(len(errors), np.nan)
    place = np.arange(len(errors))
    return np.asarray(errors[known[np.abs(place[:, None] - known).argmin(axis=1)]])


def straight_variants(
    field: IndexField,
    rays: RayBundle,
    opd: np.ndarray,
    until: Plane,
    wavelength: float,
    tolerance: float,
    options: Mapping[str, Any],
) -> Variants:
    """Return how rays, in random order, change by cause; that of "step" is what full traces bring besides `opd` [m].

    `opd` is that along straight lines, shape (n,), and `options` are backend and device of the full traces.
    """
    backend = options.get("backend") or "auto"
    backend, device, _ = choose_backend(backend, options.get("device"))
    allowance = step_allowance(field, "adaptive", None, None)
    plan = TracePlan("adaptive", backend, device, "float64", allowance, None, tolerance)
    way = stop_distance(rays.position, rays.direction, until)
    base = Rays(np.asarray(opd, np.float64), rays.direction, rays.position + way[:, None] * rays.direction)
    weight = np.broadcast_to(np.asarray(rays.weight, np.float64), way.shape)
    beyond = lost(field, rays, until)
    return variants(field, rays, base, plan, until, wavelength, weight=weight / weight.sum(), lost=beyond)
