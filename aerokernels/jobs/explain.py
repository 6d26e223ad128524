"""Explain in words what a run of a scene would do: region, grid, method, ray counts, and the errors."""

from collections.abc import Iterator

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
from aerokernels.tracing.variants.causes import budget
from aerokernels.waves import validity

Rows = Iterator[tuple[str, str]]


def explanation(scene: Scene) -> list[tuple[str, str]]:
    """Return rows of (topic, explanation). The flow is read and resampled to measure the error."""
    flow = scene.density_field()
    prepared = prepare_field(scene, flow)
    strehl = PreparedStrehl(
        prepared.field,
        scene.view,
        **trace_options(scene),
        ray_count=scene.strehl.ray_count,
        allow_truncation=scene.trace.allow_truncation,
    )
    return [
        ("scene", f"{scene.name}: {scene.title}" if scene.title else scene.name),
        *_flow_rows(flow, prepared),
        *_grid_rows(scene, prepared),
        *_strehl_rows(scene, strehl),
        ("ray optics", validity(prepared.field, scene.view).reason),
        ("rays, OPD map", f"one for each of {MAP_PIXELS} x {MAP_PIXELS} pixels in the pupil"),
        ("rays, picture", f"{FAN_RAYS}, to {FAN_PLANES - 1} planes"),
        ("rays, echo", f"{scene.beam.ray_count:,} target points; {_return_path(scene, prepared.field)}"),
        ("ranging", f"{scene.detector.ranging}, {scene.detector.sample_rate / 1e9:g} GHz samples"),
        *_echo_rows(scene, prepared.field),
    ]


def _flow_rows(flow: DensityField, prepared: Prepared) -> Rows:
    mesh, samples = getattr(flow, "mesh", None), getattr(flow, "density", None)
    if mesh is not None:
        size = f"{len(mesh.cells)} cells"
    else:
        size = "a formula" if samples is None else f"{' x '.join(map(str, samples.shape))} nodes"
    yield "flow", flow.provenance
    yield "free stream", f"{flow.ambient_density:.5g} kg/m3"
    yield "flow mesh", f"{size}, {flow.geometry}"
    axes = "r, z" if prepared.field.geometry == "axisymmetric" else "y, z"
    low, high = (f"{corner[0] * 1e3:.3g}, {corner[1] * 1e3:.3g} mm" for corner in prepared.region)
    yield "region of the rays", f"{axes} from {low} to {high}"


def _grid_rows(scene: Scene, prepared: Prepared) -> Rows:
    """Yield rows on the grid that the index is interpolated on, its measured error, and the refractivity."""
    samples, resampling, upstream = prepared.field.samples, prepared.resampling, prepared.field.upstream
    wavelength, interpolation = scene.flow.wavelength, scene.grid.interpolation
    error = ""
    if not isinstance(samples, UniformGrid):
        yield "grid", f"none: the index is interpolated on the flow's mesh, {interpolation}"
    else:
        nodes = f"{' x '.join(map(str, samples.shape))} nodes"
        if upstream is not None and upstream.columns > 0.0:
            yield "grid", f"{nodes}, resampled from the flow's cells"
            error = (
                f"{upstream.columns * 1e9:.3g} nm rms of lines through it ({upstream.columns / wavelength:.2g} waves)"
            )
        elif resampling is None:
            yield "grid", f"{nodes}, those of the flow, {interpolation}"
        else:
            rms, most = resampling.opd_rms, resampling.opd_max
            yield "grid", f"{nodes}, {scene.grid.spacing * 1e3:g} mm apart, {interpolation}"
            error = f"{rms * 1e9:.3g} nm rms, {most * 1e9:.3g} nm at most "
            error += f"({rms / wavelength:.2g} and {most / wavelength:.2g} waves)"
    if error:
        yield "error of the grid, measured", f"OPD {error}"
    if upstream is not None:
        share = f"+- {100.0 * upstream.refractivity:.2g} % of the OPD" if upstream.refractivity else "a given constant"
        yield "refractivity", f"{upstream.model}; {share}"


def _strehl_rows(scene: Scene, strehl: PreparedStrehl) -> Rows:
    """Yield rows on how the Strehl ratio is traced, what that costs, and its value and error by some of the rays."""
    plan, count = strehl.plan, strehl.job.predicted_ray_count
    yield "tracing", str(plan).splitlines()[0]
    for reason in plan.reasons:
        yield "", reason
    yield "requested OPD error", f"{scene.trace.tolerance:g} wave at {scene.flow.wavelength * 1e9:g} nm"
    yield "rays, Strehl ratio", f"{scene.strehl.ray_count:,} requested, {count:,} traced, {in_words(scene.view)}"
    each, wrong = plan.predicted_evaluations, plan.predicted_error
    cost = "cost not predicted" if each is None else f"{each:.0f} field evaluations per ray, {each * count:.2g} in all"
    yield "predicted", f"{cost}; " + ("error not predicted" if wrong is None else f"OPD error {wrong:.1g} waves")
    varied = strehl.varied(plan)
    if varied.found is None:
        return
    numbers, base = varied.numbers(strehl.request.remove), varied.found.base
    error = budget(lambda rays: numbers(rays)[0], varied.found)
    ratio, cause = Quantity(float(numbers(base)[0]), error[TOTAL], is_ratio=True), main_cause(error)
    words = f"about {ratio.value:.2f}, error {two_digits(error[TOTAL])}, by {len(base.opd)} rays; {cause}"
    yield "predicted, Strehl ratio", words
    if verdict := judge({"Strehl ratio": ratio}, cause):
        yield "warning", verdict.reason


def _return_path(scene: Scene, field: IndexField) -> str:
    """Describe how the return path of the echo is traced."""
    receiver = scene.receiver
    if receiver.return_factor == "none":
        return "return path not traced (return factor none)"
    nodes, rays = receiver.strehl_node_count, f"{receiver.ray_count:,} rays over the pupil each"
    start = f"return factor {receiver.return_factor} at "
    if nodes == "every":
        return f"{start}each target point, {rays}"
    if is_symmetric(field, Setup.of_scene(scene).plane, receiver.pupil):
        return f"{start}{int(nodes) // 2 + 1} points of a radius, by symmetry half of {rays}"
    return f"{start}{nodes} x {nodes} points, {rays}"


def _echo_rows(scene: Scene, field: IndexField) -> Rows:
    """Yield rows on the echo without flow, and on whether its range can be read."""
    echo, own = predict_echo(scene, field), scene.detector.ranging
    yield (
        "predicted, echo",
        f"{echo.peak_voltage:.4g} V, {echo.peak_power * 1e6:.4g} µW without flow; less with flow",
    )
    if own not in echo.reasons:
        some = f" if the flow leaves at least {echo.least_factor:.3f} of the peak" if echo.least_factor <= 1.0 else ""
        yield "predicted, range", f"can be read{some}"
        return
    yield "predicted, range", f"none: {echo.reasons[own]}; everything else is computed"
    if readable := [method for method in RANGING_METHODS if method not in echo.reasons]:
        yield "", f"values of detector.ranging that can read this echo: {', '.join(readable)}"
