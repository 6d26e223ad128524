"""The plan of a trace: the choices and the reasons in words. This module holds data only; planning.py makes plans."""

from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TypedDict

from aerokernels.tracing.tasks.unresolved import Sampling

from .lines import LeverArms

# Methods that a caller may request.
METHODS = ("auto", "straight", "adaptive", "paper", "fixed")
# What "auto" may take besides "adaptive": a fixed count of leapfrog steps a ray (leapfrog/sample_count.py).
LEAPFROG = "leapfrog"
PRECISIONS = ("float32", "float64")


# Per-ray arrays: unit and meaning, in the order of results.
RAY_OUTPUTS = {
    "position": ("m", "end point"),
    "direction": ("1", "unit tangent at the stop"),
    "optical_path": ("m", "integral of n ds from the start to the stop"),
    "opd": ("m", "optical path less the ambient index times the undisturbed distance to the same stop"),
    "arc_length": ("m", "length of the ray"),
    "step_error": ("m", "OPD error of the steps, estimated by the embedded formula"),
    "step_count": ("1", "accepted steps"),
    "evaluation_count": ("1", "field evaluations"),
}
# Kernels receive the requested outputs as an integer with one bit for each.
OUTPUT_BITS = {name: 1 << bit for bit, name in enumerate(RAY_OUTPUTS)}


def output_mask(outputs: frozenset) -> int:
    """Return the bits of the requested outputs."""
    return sum([bit for name, bit in OUTPUT_BITS.items() if name in outputs])


class TraceOptions(TypedDict, total=False):
    """How rays are traced: keywords of `trace`, `estimate_strehl`, `wavefront` and whatever else traces rays.

    Attributes:
        tolerance: Requested OPD error [waves].
        method: "auto", "straight", "adaptive", "paper" or "fixed".
        step: Step of method "fixed" [m].
        max_steps: Steps after which a ray is given up; None takes a generous number.
        backend: "auto", "warp", "opencl" or "reference".
        device: "cpu", "cuda:0" or an OpenCL device's name; None takes the best.
        precision: "float32" or "float64" inside the kernel.
        allow_truncation: Whether more than a thousandth of a pupil may look through disturbed air that was cut off.
    """

    tolerance: float
    method: str
    step: float | None
    max_steps: int | None
    backend: str
    device: str | None
    precision: str
    allow_truncation: bool


TraceOptions.defaults = {  # type: ignore[attr-defined]
    "tolerance": 1e-3,
    "method": "auto",
    "step": None,
    "max_steps": None,
    "backend": "auto",
    "device": None,
    "precision": "float32",
    "allow_truncation": False,
}


def complete(options: TraceOptions) -> TraceOptions:
    """Return options with the defaults of those that are not among them."""
    whole: TraceOptions = {**TraceOptions.defaults, **options}  # type: ignore[attr-defined]
    return whole


@dataclass(frozen=True)
class BundleCounts:
    """How many rays of a bundle were traced and how many were interpolated between the traced ones (bundle/)."""

    traced: int  # to interpolate between; they need not be rays of the bundle
    delivered: int  # rays of the bundle that were interpolated
    one_by_one: int  # rays of the bundle that were traced
    error: float  # greatest estimated OPD error of the interpolation [m]
    refused: dict[str, float] = field(default_factory=dict)  # approximate number of rays traced one by one, by reason

    def sentence(self, converges: bool, wavelength: float) -> str:
        """Describe the counts in a sentence for the reasons of a plan."""
        kind = "lines through a point" if converges else "parallel lines"
        text = (
            f"bundle: the rays are {kind}, a map of two parameters: {self.traced} lines were traced, {self.delivered} "
            f"rays interpolated between them (estimated error {self.error / wavelength:.1g} waves), {self.one_by_one} "
            "traced one by one"
        )
        causes = "; ".join(f"{name}: about {count:.0f}" for name, count in self.refused.items() if count >= 1.0)
        return f"{text} ({causes})" if self.one_by_one and causes else text


@dataclass(frozen=True)
class TracePlan:
    """The choices for one trace."""

    # "straight", "adaptive", "paper", "fixed", or LEAPFROG, a choice of "auto" whose rays may be retraced by
    # "adaptive"
    method: str
    backend: str
    device: str
    precision: str
    max_steps: int  # after which a ray is given up
    step: float | None  # of "fixed" [m of arc length], else None
    tolerance: float  # requested OPD error [waves]
    reasons: tuple[str, ...] = field(default=())  # one sentence for each choice
    sample_count: int = 0  # leapfrog samples of each ray, evenly spaced; 0 for every other method
    # found by a search; `sample_count` may be more: confirmed for a field like this, or of cubes
    searched_count: int = 0
    cubes: bool = False  # whether leapfrog samples evaluate polynomials of cubes of cells (cube_polynomials.py)
    quadrature_error_scale: float = 0.0  # error of a ray's sum over its difference from that over every third sample
    # error by the ray's displacement over int P^2 / p_t dt, of the momenta across and along it
    trajectory_error_scale: float = 0.0
    sampling: Sampling | None = None  # by which a ray's error includes structure between samples; None: negligible
    # greatest components of a unit vector for which the number of samples holds; None: all are known
    steepest: tuple[float, float, float] | None = None
    lever_arms: LeverArms | None = None  # see lines.py; None where it was not needed
    predicted_evaluations: float | None = None  # of a ray across the box, before any ray is traced
    predicted_error: float | None = None  # OPD error of a pilot bundle, or the tolerance [waves]
    bundle: BundleCounts | None = None  # None where each ray was traced

    @cached_property
    def controls_error(self) -> bool:
        """Whether the method itself keeps rays within the tolerance, or marks those that are not."""
        return self.method not in ("fixed", "paper")

    @cached_property
    def looks_up_cubes(self) -> bool:
        """Whether this trace evaluates polynomials of cubes; in float64 such a plan evaluates the spline."""
        return self.cubes and self.sample_count > 0 and self.precision == "float32"

    @cached_property
    def compiled_method(self) -> str:
        """The method that kernels are compiled for: leapfrog uses those of "straight"."""
        return "straight" if self.method == LEAPFROG else self.method

    def __str__(self) -> str:
        """One line of choices, followed by one line for each reason."""
        head = f"{self.method} on {self.backend} ({self.device}), {self.precision}"
        return "\n".join([head, *(f"  {reason}" for reason in self.reasons)])

    def as_dict(self) -> dict:
        """Return the plan as a dictionary for a summary file."""
        names = ("method", "backend", "device", "precision", "max_steps", "step", "tolerance", "sample_count", "cubes")
        plain = {name: getattr(self, name) for name in (*names, "predicted_evaluations", "predicted_error")}
        bundle = None if self.bundle is None else asdict(self.bundle)
        return {**plain, "bundle": bundle, "reasons": list(self.reasons)}
