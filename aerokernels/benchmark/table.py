"""A benchmark as rows of a table of text."""

from typing import Any

COLUMNS = (
    "suite",
    "who",
    "how",
    "M rays/s, kernel",
    "per core",
    "end to end",
    "per CPU s",
    "evaluations",
    "share",
    "error",
)


def table_rows(bench: dict[str, Any]) -> list[tuple[str, ...]]:
    """One row for each run, in the order of COLUMNS."""
    return [_run_row(run) for run in bench["runs"]]


def _run_row(run: dict) -> tuple[str, ...]:
    made, chosen = run["settings"], run["plan"]["method"]
    method = made["method"] if made["method"] == chosen else f"{made['method']}: {chosen}"
    symmetry = made.get("symmetry")
    if run["suite"] == "bundles":
        method = f"{made['kind']}, bundle {made['bundle']}: {chosen}"
    how = f"{method}, {made['precision']}, {made['tolerance']:g} wave" + (
        f", symmetry {symmetry}" if symmetry is not None else ""
    )
    return (
        run["suite"],
        f"{made['backend']} {made['device']}",
        how,
        millions(run.get("kernel_rays_per_second")),
        millions(run.get("kernel_rays_per_core_second")),
        _end_to_end(run),
        millions(run.get("rays_per_cpu_second")),
        f"{run['evaluations_per_ray']:.1f}",
        _share(run.get("ceiling")),
        _error(run),
    )


def _end_to_end(run: dict) -> str:
    if run["suite"] in ("cone", "bundles"):
        return millions(run["rays_per_second"])
    if run["suite"] == "strehl":
        return _spread(run["wall_seconds"], 1e3, "ms")
    return _spread(run["ratios_per_second"], 1.0, "ratios/s")


def _error(run: dict) -> str:
    if run["suite"] in ("cone", "bundles"):
        return cone_error(run["error"])
    if run["suite"] == "strehl":
        return f"{run['error']['value']:+.1e}"
    return "-"


def cone_error(error: dict) -> str:
    """The errors of a run over the true rays."""
    if error["opd_rms_waves"] is None:
        return "no ray arrived"
    lost = f", {error['lost_ray_count']} lost" if error["lost_ray_count"] else ""
    return f"{error['opd_rms_waves']:.1e} wave rms, {error['direction_max_urad']:.2g} urad{lost}"


def _share(ceiling: dict | None) -> str:
    if ceiling is None or ceiling["arithmetic_share"] is None:
        return "-"
    return f"{100.0 * ceiling['arithmetic_share']:.0f} % flops, {100.0 * ceiling['load_share']:.0f} % loads"


def millions(measured: dict | None) -> str:
    """A rate and its error, in millions a second."""
    return "-" if measured is None else _spread(measured, 1e-6, "")


def _spread(measured: dict | None, scale: float, unit: str) -> str:
    if measured is None:
        return "-"
    error = measured["standard_error"]
    text = f"{measured['median'] * scale:.3g}" + ("" if error is None else f" ± {error * scale:.1g}")
    return f"{text} {unit}".rstrip()
