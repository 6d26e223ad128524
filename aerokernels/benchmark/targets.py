"""The choices of a benchmark and the backends and devices to measure, checked before anything is measured."""

from dataclasses import dataclass

from aerokernels.inputs.checks import check_choice, check_count, check_positive
from aerokernels.tracing.engines.choice import available_backends, choose_backend
from aerokernels.tracing.plan import METHODS, PRECISIONS

SUITES = ("cone", "strehl", "sweep", "bundles")
DEFAULT_METHODS = ("auto", "adaptive", "straight")
RAY_COUNT = 1_000_000
# The reference traces one ray at a time in Python: more rays would take hours.
REFERENCE_RAYS = 10_000


@dataclass(frozen=True)
class Settings:
    """The choices of a benchmark.

    Attributes:
        suites: Names from SUITES, none for all.
        backends: Names of backends; none for all that are available except the reference.
        device: A device's name, None for the best of each backend.
        precisions: "float32", "float64" or both.
        methods: Tracing methods, see `trace`.
        tolerances: Requested OPD errors [waves]; several show run time against error.
        ray_count: Rays of a trace or of a Strehl ratio.
        repeats: Timed calls of each run, after one that compiles.

    Raises:
        ValueError: A name that is not known or a number that makes no sense.
    """

    suites: tuple[str, ...] = ()
    backends: tuple[str, ...] = ()
    device: str | None = None
    precisions: tuple[str, ...] = ("float32",)
    methods: tuple[str, ...] = DEFAULT_METHODS
    tolerances: tuple[float, ...] = (1e-3,)
    ray_count: int = RAY_COUNT
    repeats: int = 5

    def __post_init__(self) -> None:
        """Check names and numbers."""
        for what, names, known in (
            ("suite", self.suites, SUITES),
            ("precision", self.precisions, PRECISIONS),
            ("method", self.methods, [name for name in METHODS if name != "fixed"]),
            ("backend", self.backends, ("warp", "opencl", "reference")),
        ):
            for name in names:
                check_choice(name, what, known)
        for name, least in (("repeats", 1), ("ray_count", 16)):
            object.__setattr__(self, name, check_count(getattr(self, name), name, least))
        for tolerance in self.tolerances:
            check_positive(tolerance, "tolerance", "waves")
        if "reference" in self.backends and self.ray_count > REFERENCE_RAYS:
            raise ValueError(
                f"backend 'reference' traces one ray at a time: {self.ray_count} rays would take hours, give at most "
                f"{REFERENCE_RAYS}"
            )

    @property
    def wanted(self) -> tuple[str, ...]:
        """The suites to run, each once, in the order of SUITES."""
        return tuple(name for name in SUITES if name in (self.suites or SUITES))


def find_targets(settings: Settings) -> list[tuple[str, str]]:
    """Pairs of backend and device to measure.

    Raises:
        ValueError: A named backend or device is not available.
    """
    backends = settings.backends or _present(settings.device)
    return [choose_backend(backend, settings.device)[:2] for backend in dict.fromkeys(backends)]


def _present(device: str | None) -> tuple[str, ...]:
    """The available backends that have the device, except the reference."""
    here = {info.backend for info in available_backends() if info.available} - {"reference"}
    found = []
    for backend in sorted(here, reverse=True):  # warp, then opencl
        try:
            choose_backend(backend, device)
        except ValueError:
            continue
        found.append(backend)
    if not found:
        choose_backend("auto", device)  # raises an error that names what is available
        raise ValueError(f"device {device!r} is not there: see `aerokernels backends`")
    return tuple(found)


def on_processor(backend: str, device: str) -> bool:
    """Whether a device is the computer's own CPU."""
    return device == "cpu" or any(
        (info.backend, info.device) == (backend, device) and info.description.startswith("CPU")
        for info in available_backends()
    )
