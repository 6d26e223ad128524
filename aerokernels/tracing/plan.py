"""What a trace will do, and why, in words."""

from dataclasses import dataclass, field

import numpy as np

from ..medium import IndexField
from .choice import predict_evaluations
from .held import held_error
from .levers import Levers
from .unresolved import Sampling

METHODS = ("auto", "straight", "adaptive", "paper", "fixed")
PRECISIONS = ("float32", "float64")
PIECEWISE_LINEAR = ("linear", "bilinear", "bilinear-barron")


@dataclass(frozen=True)
class TracePlan:
    """The choices for one trace.

    Attributes:
        method: "straight", "adaptive", "paper" or "fixed".
        backend: "warp" or "reference".
        device: Device of the backend.
        precision: "float32" or "float64".
        max_steps: Steps after which a ray is given up.
        step: Step of "fixed" [m of arc length], else None.
        tolerance: OPD error asked for [waves].
        reasons: Why, one sentence for each choice.
        columns: Whether collimated rays are looked up in tables of what each column gathers, see columns.py.
        sample_count: Samples of a ray whose samples are even, see even.py; 0 where they are not.
        even_share: The share of a sum's difference from that over every third sample that is taken for its error.
        bend_share: The share of int P^2 / w dt, P the momentum across the ray, that is taken for its course's error.
        sampling: How far apart even samples are, for a ray's share of what lies between them, see unresolved.py; None
            where all of that is negligible.
        levers: How far the rays fly and at what angle they meet their stop, see levers.py; None where nobody asked.
        predicted_evaluations: Field evaluations of a ray across the box, predicted before any ray is traced.
        predicted_error: OPD error predicted [waves]: what a pilot bundle made, what tables estimate, or the tolerance.
    """

    method: str
    backend: str
    device: str
    precision: str
    max_steps: int
    step: float | None
    tolerance: float
    reasons: tuple[str, ...] = field(default=())
    columns: bool = False
    sample_count: int = 0
    even_share: float = 0.0
    bend_share: float = 0.0
    sampling: Sampling | None = None
    levers: Levers | None = None
    predicted_evaluations: float | None = None
    predicted_error: float | None = None

    @property
    def controls_error(self) -> bool:
        """Whether the method itself keeps rays within the tolerance, or says which are not."""
        return self.method in ("adaptive", "straight")

    def __str__(self) -> str:
        """One line of choices, then one line for each reason."""
        head = f"{self.method} on {self.backend} ({self.device}), {self.precision}"
        return "\n".join([head, *(f"  {reason}" for reason in self.reasons)])

    def as_dict(self) -> dict:
        """The plan for a summary file."""
        return {
            "method": self.method,
            "backend": self.backend,
            "device": self.device,
            "precision": self.precision,
            "max_steps": self.max_steps,
            "step": self.step,
            "tolerance": self.tolerance,
            "columns": self.columns,
            "sample_count": self.sample_count,
            "predicted_evaluations": self.predicted_evaluations,
            "predicted_error": self.predicted_error,
            "reasons": list(self.reasons),
        }


def check_tolerance(tolerance: float) -> float:
    """The tolerance [waves], or a refusal of one that is not a positive number."""
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance must be positive (waves of OPD error), got {tolerance!r}")
    return tolerance


def make_plan(
    field: IndexField,
    *,
    method,
    backend,
    device,
    precision,
    step,
    tolerance,
    max_steps,
    path_length,
    wavelength,
    directions,
    columns: str | None = None,
) -> TracePlan:
    """Check the caller's choices and fill in those left to "auto".

    `columns` says why collimated rays may be looked up in tables, None that they may not.

    Raises:
        ValueError: An unknown name or a number that makes no sense, with the remedy.
    """
    from .backends import choose_backend

    if method not in METHODS:
        raise ValueError(f"method {method!r} is not known: choose one of {', '.join(METHODS)}")
    if precision not in PRECISIONS:
        raise ValueError(f"precision {precision!r} is not known: choose 'float32' or 'float64'")
    check_tolerance(tolerance)
    if method == "fixed":
        if step is None or not (np.isfinite(step) and step > 0.0):
            raise ValueError(f"method 'fixed' needs step, a positive length of arc in metres, got {step!r}")
    elif step is not None:
        raise ValueError(f"step belongs to method 'fixed', not to {method!r}: leave it out or choose 'fixed'")
    # Names may come from an array as NumPy's strings, which are other keys to the caches of kernels.
    method, precision = str(method), str(precision)
    reasons = []
    by_columns = False
    predicted = None
    if columns is not None and method in ("auto", "straight") and backend != "reference":
        method = "straight"
        reasons.append(columns)
        by_columns = True
    elif method == "auto" and backend == "reference":
        method = "adaptive"
        reasons.append("method adaptive: the reference is the answer that others are measured against")
    elif method == "auto":
        method = "adaptive"
        predicted = predict_evaluations(field, held_error(field, tolerance * wavelength), directions)
        reasons.append(f"method adaptive: error control, about {predicted:.0f} evaluations a ray across the box")
    backend, device, why = choose_backend(backend, device)
    reasons.append(why)
    dimension = {"volume": "a volume", "planar": "two axes, x is never expanded"}.get(
        field.geometry, "r and z, never expanded to a volume"
    )
    reasons.append(f"{field.geometry} field: looked up in {dimension}")
    reasons.append("outside the field's box rays fly free in one step")
    if field.body is None:
        reasons.append("no body: no wall test in the kernel")
    if method == "fixed" and max_steps is None and step < 1e-8 * _diagonal(field):
        raise ValueError(
            f"a step of {step:g} m would take more than 1e8 steps through a box of {_diagonal(field):.3g} m: give a "
            "longer one, or let method 'adaptive' choose"
        )
    if max_steps is None:
        max_steps = step_allowance(field, method, step, path_length)
    elif not isinstance(max_steps, (int, np.integer)) or max_steps < 1:
        raise ValueError(f"max_steps must be a whole number of at least 1, got {max_steps!r}")
    if by_columns:
        predicted = 1.0
    elif predicted is None and method == "fixed":
        predicted = 3.0 * _diagonal(field) / step
    return TracePlan(
        method,
        backend,
        device,
        precision,
        int(max_steps),
        step,
        float(tolerance),
        tuple(reasons),
        by_columns,
        predicted_evaluations=predicted,
        predicted_error=None if method in ("paper", "fixed") or by_columns else float(tolerance),
    )


def step_allowance(field: IndexField, method: str, step, path_length) -> int:
    """Generous by a factor of ten over what a ray across the box needs, so that only trapped rays meet it."""
    diagonal = _diagonal(field)
    if path_length is not None:
        diagonal = max(diagonal, path_length)
    # Where the gradient jumps at every cell, light can run along a ridge of the index in steps of a few LEAST_STEP.
    cells = 0.002 if field.interpolation in PIECEWISE_LINEAR else 0.02
    finest = float(field.samples.paper_step.min()) if method == "paper" else float(np.min(field.spacing)) * cells
    if method == "fixed":
        finest = step
    return int(min(10.0 * diagonal / finest + 1000.0, 2_000_000_000.0))


def _diagonal(field: IndexField) -> float:
    low, high = field.box
    return float(np.linalg.norm(np.where(np.isfinite(high - low), high - low, 0.0)))
