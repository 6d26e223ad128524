"""Explain in words what a run of a scene would do: region, grid, method, ray counts, and the errors."""

from aerokernels.display.quantities import TOTAL, Quantity, judge, main_cause, two_digits
from aerokernels.flow import DensityField
from aerokernels.focus.estimate import PreparedStrehl
from aerokernels.jobs.run import FAN_PLANES, FAN_RAYS, MAP_PIXELS
from aerokernels.lidar import RANGING_METHODS
from aerokernels.lidar.parts import Setup, trace_options
from aerokernels.lidar.rangefinder import predict_echo
from aerokernels.lidar.return_paths import is_symmetric
from aerokernels.medium import IndexField
from aerokernels.medium.grid import UniformGrid
from aerokernels.prepare import Prepared, prepare_field
from aerokernels.scene import Scene
from aerokernels.scene.pupil_table import in_words
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.variants.causes import budget
from aerokernels.waves import validity


def explanation(scene: Scene) -> list[tuple[str, str]]:
    """Return rows of (topic, explanation). The flow is read and resampled: that takes a second and measures the error.

    Raises:
        ValueError: A backend or device that is not available, or a region or spacing that cannot be used.
    """
    flow = scene.density_field()
    prepared = prepare_field(scene, flow)
    pupil = scene.view
    strehl = PreparedStrehl(
        prepared.field,
        pupil,
        **trace_options(scene),
        ray_count=scene.strehl.ray_count,
        allow_truncation=scene.trace.allow_truncation,
    )
    plan, count = strehl.plan, strehl.job.predicted_ray_count
    low, high = prepared.region
    axes = "r, z" if prepared.field.geometry == "axisymmetric" else "y, z"
    wavelength = scene.flow.wavelength
    rows = [
        ("scene", f"{scene.name}: {scene.title}" if scene.title else scene.name),
        ("flow", flow.provenance),
        ("free stream", f"{flow.ambient_density:.5g} kg/m3"),
        ("flow mesh", _mesh_in_words(flow)),
        (
            "region of the rays",
            f"{axes} from {low[0] * 1e3:.3g}, {low[1] * 1e3:.3g} mm to {high[0] * 1e3:.3g}, {high[1] * 1e3:.3g} mm",
        ),
    ]
    upstream = prepared.field.upstream
    rows += _grid_rows(scene, prepared)
    if upstream is not None:
        share = f"+- {100.0 * upstream.refractivity:.2g} % of the OPD" if upstream.refractivity else "a given constant"
        rows.append(("refractivity", f"{upstream.model}; {share}"))
    rows += [
        ("tracing", str(plan).splitlines()[0]),
        *(("", reason) for reason in plan.reasons),
        ("requested OPD error", f"{scene.trace.tolerance:g} wave at {wavelength * 1e9:g} nm"),
        (
            "rays, Strehl ratio",
            f"{scene.strehl.ray_count:,} requested, {count:,} traced, {in_words(pupil)}",
        ),
        ("predicted", _prediction(plan, count)),
        *_predicted_ratio(strehl),
        ("ray optics", validity(prepared.field, pupil).reason),
        ("rays, OPD map", f"one for each of {MAP_PIXELS} x {MAP_PIXELS} pixels in the pupil"),
        ("rays, picture", f"{FAN_RAYS}, to {FAN_PLANES - 1} planes"),
        (
            "rays, echo",
            f"{scene.beam.ray_count:,} target points; {_return_path(scene, prepared.field)}",
        ),
        ("ranging", f"{scene.detector.ranging}, {scene.detector.sample_rate / 1e9:g} GHz samples"),
        *_predicted_echo(scene, prepared.field),
    ]
    return rows


def _grid_rows(scene: Scene, prepared: Prepared) -> list[tuple[str, str]]:
    """Rows on the grid that the index is interpolated on, and its measured error."""
    samples, resampling, upstream = prepared.field.samples, prepared.resampling, prepared.field.upstream
    wavelength, interpolation = scene.flow.wavelength, scene.grid.interpolation
    if not isinstance(samples, UniformGrid):
        return [("grid", f"none: the index is interpolated on the flow's mesh, {interpolation}")]
    nodes = f"{' x '.join(map(str, samples.shape))} nodes"
    if upstream is not None and upstream.columns > 0.0:
        error = (
            f"OPD {upstream.columns * 1e9:.3g} nm rms of lines through it ({upstream.columns / wavelength:.2g} waves)"
        )
        return [("grid", f"{nodes}, resampled from the flow's cells"), ("error of the grid, measured", error)]
    if resampling is None:
        return [("grid", f"{nodes}, those of the flow, {interpolation}")]
    error = (
        f"OPD {resampling.opd_rms * 1e9:.3g} nm rms, {resampling.opd_max * 1e9:.3g} nm at most "
        f"({resampling.opd_rms / wavelength:.2g} and {resampling.opd_max / wavelength:.2g} waves)"
    )
    return [
        ("grid", f"{nodes}, {scene.grid.spacing * 1e3:g} mm apart, {interpolation}"),
        ("error of the grid, measured", error),
    ]


def _predicted_ratio(strehl: PreparedStrehl) -> list[tuple[str, str]]:
    """Rows on the Strehl ratio and its error, of some of the rays."""
    varied = strehl.varied(strehl.plan)
    if varied.found is None:
        return []
    numbers, base = varied.numbers(strehl.request.remove), varied.found.base
    error = budget(lambda rays: numbers(rays)[0], varied.found)
    ratio = Quantity(float(numbers(base)[0]), error[TOTAL], is_ratio=True)
    words = f"about {ratio.value:.2f}, error {two_digits(error[TOTAL])}, by {len(base.opd)} rays; {main_cause(error)}"
    rows = [("predicted, Strehl ratio", words)]
    verdict = judge({"Strehl ratio": ratio}, main_cause(error))
    return [*rows, ("warning", verdict.reason)] if verdict else rows


def _predicted_echo(scene: Scene, field: IndexField) -> list[tuple[str, str]]:
    """Rows on the echo without flow, and on whether its range can be read."""
    found, own = predict_echo(scene, field), scene.detector.ranging
    rows = [
        ("predicted, echo", f"{found.peak_voltage:.4g} V, {found.peak_power * 1e6:.4g} µW without flow; less with flow")
    ]
    if own in found.reasons:
        rows.append(("predicted, range", f"none: {found.reasons[own]}; everything else is computed"))
    elif found.least_factor <= 1.0:
        rows.append(
            ("predicted, range", f"can be read if the flow leaves at least {found.least_factor:.3f} of the peak")
        )
    else:
        rows.append(("predicted, range", "can be read"))
    readable = [method for method in RANGING_METHODS if method not in found.reasons]
    if own in found.reasons and readable:
        rows.append(("", f"values of detector.ranging that can read this echo: {', '.join(readable)}"))
    return rows


def _prediction(plan: TracePlan, ray_count: int) -> str:
    """Describe the predicted cost and error of the Strehl ratio's rays."""
    each, error = plan.predicted_evaluations, plan.predicted_error
    cost = (
        "cost not predicted" if each is None else f"{each:.0f} field evaluations per ray, {each * ray_count:.2g} in all"
    )
    if error is None:
        return f"{cost}; error not predicted"
    return f"{cost}; OPD error {error:.1g} waves"


def _return_path(scene: Scene, field: IndexField) -> str:
    """Describe how the return path of the echo is traced."""
    receiver = scene.receiver
    if receiver.return_factor == "none":
        return "return path not traced (return factor none)"
    nodes = receiver.strehl_node_count
    start = f"return factor {receiver.return_factor} at "
    if nodes == "every":
        return f"{start}each target point, {receiver.ray_count:,} rays over the pupil each"
    if is_symmetric(field, Setup.of_scene(scene).plane, receiver.pupil):
        count = int(nodes) // 2 + 1
        return f"{start}{count} points of a radius, by symmetry half of {receiver.ray_count:,} rays over the pupil each"
    return f"{start}{nodes} x {nodes} points, {receiver.ray_count:,} rays over the pupil each"


def _mesh_in_words(flow: DensityField) -> str:
    """Describe a flow's number of cells or nodes, and its geometry."""
    mesh = getattr(flow, "mesh", None)
    if mesh is not None:
        return f"{len(mesh.cells)} cells, {flow.geometry}"
    samples = getattr(flow, "density", None)
    count = "a formula" if samples is None else f"{' x '.join(map(str, samples.shape))} nodes"
    return f"{count}, {flow.geometry}"
