"""One work-precision run: a setting, its two errors, its evaluations and its time.

The two errors are:

    tracing   against a tight trace of the same interpolated field: the error of steps and rounding
    total     against the field that was sampled: includes the interpolant's own error

Times are kernel times without compilation. Settings are timed in interleaved order, so that other load on the machine
affects them alike.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from aerokernels.benchmark.scenes import Truth, integrate, potential_of
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import TraceResult, trace

from .fields import Case

WAVELENGTH = 905e-9
INTERPOLATIONS = ("cubic", "linear", "monotone")
PRECISIONS = ("float64", "float32")
TIGHT = {"method": "adaptive", "precision": "float64", "max_steps": 3_000_000}
# Where the gradient jumps at every cell, tighter tolerances only resolve the jumps.
TIGHT_TOLERANCE = {"cubic": 1e-9, "monotone": 1e-8, "linear": 1e-5}
# Evaluations in one timed launch: enough for accurate timing, few enough for hundreds of settings.
TIMED_EVALUATIONS = 2e6


@dataclass(frozen=True)
class Setting:
    """A setting of `trace`; `value` is the tolerance [waves], or the step of "fixed" [cells], None for "paper"."""

    method: str
    value: float | None = None

    def arguments(self, cell: float) -> dict[str, Any]:
        """Arguments of `trace` on a field of this node spacing [m]."""
        if self.method == "fixed":
            return {"method": "fixed", "step": self.value * cell}
        if self.value is None:
            return {"method": self.method}
        return {"method": self.method, "tolerance": self.value}


@dataclass(frozen=True)
class Error:
    """Differences over rays: OPD [waves], direction [microradian]."""

    opd_rms: float = np.nan
    opd_max: float = np.nan
    direction_rms: float = np.nan
    direction_max: float = np.nan


@dataclass(eq=False)
class Run:
    """Results of one setting; `seconds` are kernel times per ray [s], one for each repeat."""

    case: str
    interpolation: str
    precision: str
    setting: Setting
    chosen: str
    device: str
    ray_count: int
    good_count: int
    evaluations: float
    steps: float
    tracing: Error
    total: Error
    reported_step: float
    reported_total: float
    compile_seconds: float
    timed_rays: int = 0
    seconds: list[float] = field(default_factory=list)

    def microseconds(self) -> tuple[float, float, float]:
        """Median, least and greatest kernel time per ray [us]."""
        times = 1e6 * np.array(self.seconds or [np.nan])
        return float(np.median(times)), float(times.min()), float(times.max())

    def row(self) -> list[Any]:
        """The run as a row of the CSV file, see HEADING."""
        numbers = [self.evaluations, self.steps]
        numbers += [getattr(error, f.name) for error in (self.tracing, self.total) for f in fields(Error)]
        numbers += [self.reported_step, self.reported_total, *self.microseconds(), self.compile_seconds]
        return [
            self.case,
            self.interpolation,
            self.precision,
            self.setting.method,
            "" if self.setting.value is None else self.setting.value,
            {"fixed": "cells", "paper": ""}.get(self.setting.method, "waves"),
            self.chosen,
            self.device,
            self.ray_count,
            self.good_count,
            self.timed_rays,
            len(self.seconds),
            *("" if np.isnan(number) else f"{number:.5g}" for number in numbers),
        ]


HEADING = [
    *("field", "interpolation", "precision", "method", "tolerance_or_step", "unit", "method_chosen", "device"),
    *("ray_count", "ray_count_ok", "timed_ray_count", "repeat_count", "evaluations_per_ray", "steps_per_ray"),
    *(
        f"{kind}_{name}"
        for kind in ("tracing", "total")
        for name in ("opd_rms_waves", "opd_max_waves", "direction_rms_urad", "direction_max_urad")
    ),
    *("reported_step_error_waves", "reported_total_error_waves"),
    *("kernel_us_per_ray_median", "kernel_us_per_ray_min", "kernel_us_per_ray_max", "compile_s"),
]


def difference(result: TraceResult, other: Truth | TraceResult, good: np.ndarray) -> Error:
    """Errors of one trace against another, or against the truth, over the rays that arrived."""
    opd = (result.opd - other.opd)[good] / WAVELENGTH
    turn = 1e6 * np.linalg.norm((result.direction - other.direction)[good], axis=1)
    if not len(opd):
        return Error()
    return Error(
        float(np.sqrt(np.mean(opd**2))),
        float(np.abs(opd).max()),
        float(np.sqrt(np.mean(turn**2))),
        float(turn.max()),
    )


@dataclass(eq=False)
class Bench:
    """A case under one interpolant, with the references for its runs."""

    case: Case
    field: IndexField
    rays: RayBundle
    tight: TraceResult
    truth: Truth | None

    @classmethod
    def prepare(cls, case: Case, interpolation: str, rays: RayBundle, truth: Truth | None) -> "Bench":
        """Make the tight trace."""
        index = case.field.with_interpolation(interpolation)
        tolerance = TIGHT_TOLERANCE[index.interpolation]
        tight = trace(index, rays, until=case.until, wavelength=WAVELENGTH, tolerance=tolerance, **TIGHT)
        return cls(case, index, rays, tight, truth)

    def run(self, setting: Setting, precision: str) -> Run:
        """Measure a setting's errors and evaluations; afterwards its kernel is compiled."""
        result = self.trace(setting, precision, self.rays)
        good = result.ok & self.tight.ok
        step_error = np.abs(result.step_error[good]).max(initial=0.0)
        return Run(
            case=self.case.name,
            interpolation=self.field.interpolation,
            precision=precision,
            setting=setting,
            chosen=result.plan.method,
            device=result.plan.device,
            ray_count=self.rays.ray_count,
            good_count=int(good.sum()),
            evaluations=float(result.evaluation_count.mean()),
            steps=float(result.step_count.mean()),
            tracing=difference(result, self.tight, good),
            total=Error() if self.truth is None else difference(result, self.truth, good),
            reported_step=float(step_error) / WAVELENGTH,
            reported_total=float(result.error["total"]) / WAVELENGTH,
            compile_seconds=float(result.seconds["compile"]),
        )

    def trace(self, setting: Setting, precision: str, rays: RayBundle) -> TraceResult:
        """Trace rays by a setting."""
        return trace(
            self.field,
            rays,
            until=self.case.until,
            wavelength=WAVELENGTH,
            precision=precision,
            **setting.arguments(self.case.cell),
        )

    def check(self) -> tuple[Error, Error]:
        """Compare the tight trace with a fixed step of 1/64 cell, and a few rays with SciPy on the interpolant."""
        fine = self.trace(Setting("fixed", 1.0 / 64.0), "float64", self.rays)
        rows = np.linspace(0, self.rays.ray_count - 1, 4).astype(int)
        few = self.rays[rows]
        z_end = float(self.case.until.point[2])
        if self.field.body is None:

            def formula(x, y, z):
                contrast, slope = self.field.evaluate(np.c_[x, y, np.minimum(z, z_end)])
                return contrast, slope[:, :2].T

            ambient = self.field.ambient_index
            other: Any = integrate(potential_of(formula, ambient), ambient, z_end, self.case.cell, few)
        else:
            other = trace(self.field, few, until=self.case.until, backend="reference", precision="float64")
        by_scipy = Truth(other.position, other.direction, other.opd)
        mine = Truth(*(getattr(self.tight, name)[rows] for name in ("position", "direction", "opd")))
        return (
            difference(fine, self.tight, fine.ok & self.tight.ok),
            difference(mine, by_scipy, self.tight.ok[rows]),
        )


def measure_times(
    runs: Iterable[tuple[Bench, Run]], largest: RayBundle, repeat_count: int, report: Callable[[int], None]
) -> None:
    """Time every run `repeat_count` times, interleaved, on enough of the rays for TIMED_EVALUATIONS.

    Each time it runs twice and the second run counts: other kernels have run since its last turn.
    """
    runs = list(runs)
    for repeat in range(repeat_count):
        report(repeat)
        for bench, run in runs:
            wanted = TIMED_EVALUATIONS / max(run.evaluations, 1.0)
            run.timed_rays = int(np.clip(wanted, min(256, largest.ray_count), largest.ray_count))
            for _ in range(2):
                result = bench.trace(run.setting, run.precision, largest[: run.timed_rays])
            run.seconds.append(result.seconds["kernel"] / run.timed_rays)
