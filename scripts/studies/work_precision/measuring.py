"""The settings that are measured, and the measurement of one field."""

from collections.abc import Callable

from .fields import Case, radial_parallel, sech
from .runs import INTERPOLATIONS, PRECISIONS, Bench, Error, Run, Setting, measure_times

# From coarser than is useful, so that the loosest target is inside every curve.
TOLERANCES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # [waves]
STEPS = (32.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125)  # [cells]
SETTINGS = [
    *(Setting("adaptive", tolerance) for tolerance in TOLERANCES),
    *(Setting("fixed", step) for step in STEPS),
    Setting("paper"),
    *(Setting("straight", tolerance) for tolerance in TOLERANCES),
    *(Setting("auto", tolerance) for tolerance in TOLERANCES),
]
QUICK_SETTINGS = [
    *(Setting("adaptive", tolerance) for tolerance in (1e-1, 1e-3, 1e-5)),
    *(Setting("fixed", step) for step in (8.0, 2.0, 1.0)),
    Setting("auto", 1e-3),
]
PEER_SETTINGS = [Setting("adaptive", tolerance) for tolerance in (1e-2, 1e-3)]


def measure(
    case: Case, ray_count: int, timed_count: int, repeats: int, quick: bool, say: Callable[[str], None]
) -> tuple[list[Run], dict[tuple[str, str], tuple[Error, Error]]]:
    """All runs of a case, and the deviations that confirm its tight traces."""
    rays = case.bundle(ray_count)
    truth = None if case.exact is None else case.exact(rays)
    paired, checks = [], {}
    # Where rays bend through the whole field the method "straight" is not meaningful.
    settings = [setting for setting in SETTINGS if not (case.bends and setting.method == "straight")]
    # Neither are the piecewise smooth interpolants: on that grid their own error is a wave and more.
    for interpolation in INTERPOLATIONS[: 1 if quick or case.bends else None]:
        bench = Bench.prepare(case, interpolation, rays, truth)
        if not quick:
            checks[case.name, interpolation] = bench.check()
        for precision in ("float64",) if quick else PRECISIONS:
            paired += [(bench, bench.run(setting, precision)) for setting in (QUICK_SETTINGS if quick else settings)]
    measure_times(paired, case.bundle(timed_count), repeats, lambda k: say(f"  times, {k + 1} of {repeats}"))
    return [run for _, run in paired], checks


def measure_peers(ray_count: int) -> list[Run]:
    """Runs with the rays for which others' figures exist."""
    runs = []
    for case in (radial_parallel(), sech(0.25e-3), sech(0.05e-3)):
        rays = case.bundle(ray_count)
        assert case.exact is not None
        bench = Bench.prepare(case, "cubic", rays, case.exact(rays))
        runs += [bench.run(setting, precision) for precision in PRECISIONS for setting in PEER_SETTINGS]
    return runs
