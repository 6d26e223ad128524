"""What a run of a scene would do, in words: region, grid, method, ray counts, and the error of the grid."""

from aerokernels.echo.paths import target_plane
from aerokernels.echo.return_paths import is_symmetric
from aerokernels.medium import IndexField
from aerokernels.medium.grid import UniformGrid
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene
from aerokernels.strehl import plan_strehl
from aerokernels.study.views import FAN_PLANES, FAN_RAYS, PUPIL_SAMPLES, forward_pupil, pupil_samples, trace_options
from aerokernels.tracing.plan import TracePlan


def explanation(scene: Scene) -> list[tuple[str, str]]:
    """Pairs of what and how. The flow is read and resampled, since that takes a second and gives measured errors.

    Raises:
        ValueError: A backend or device that is not there, or a region or spacing that cannot be had.
    """
    prepared = prepare_field(scene)
    pupil = forward_pupil(scene)
    plan, count = plan_strehl(
        prepared.field,
        pupil,
        **trace_options(scene),
        ray_count=scene.strehl.ray_count,
        allow_truncation=scene.trace.allow_truncation,
    )
    low, high = prepared.region
    axes = "r, z" if prepared.field.geometry == "axisymmetric" else "y, z"
    wavelength = scene.flow.wavelength
    rows = [
        ("scene", f"{scene.name}: {scene.title}" if scene.title else scene.name),
        ("flow", prepared.density.provenance),
        ("free stream", f"{prepared.density.ambient_density:.5g} kg/m3"),
        ("flow mesh", f"{len(prepared.density.mesh.cells)} cells, {prepared.density.geometry}"),
        (
            "part that rays can meet",
            f"{axes} from {low[0] * 1e3:.3g}, {low[1] * 1e3:.3g} mm to {high[0] * 1e3:.3g}, {high[1] * 1e3:.3g} mm",
        ),
    ]
    resampling = prepared.resampling
    samples = prepared.field.samples
    if resampling is None or not isinstance(samples, UniformGrid):
        rows.append(("grid", f"none: samples are looked up on the flow's mesh, {scene.grid.interpolation}"))
    else:
        shape = " x ".join(str(count) for count in samples.shape)
        rows += [
            ("grid", f"{shape} nodes, {scene.grid.spacing * 1e3:g} mm apart, {scene.grid.interpolation}"),
            (
                "error of the grid",
                f"OPD {resampling.opd_rms * 1e9:.3g} nm rms, {resampling.opd_max * 1e9:.3g} nm at most, measured "
                f"({resampling.opd_rms / wavelength:.2g} and {resampling.opd_max / wavelength:.2g} waves)",
            ),
        ]
    inside, sampled, _ = pupil_samples(prepared.field, scene, PUPIL_SAMPLES)
    shared = ", those at one distance from the axis share a ray" if len(sampled) < inside.sum() else ""
    rows += [
        ("tracing", str(plan).splitlines()[0]),
        *(("", reason) for reason in plan.reasons),
        ("error asked for", f"{scene.trace.tolerance:g} wave at {wavelength * 1e9:g} nm"),
        (
            "rays, Strehl ratio",
            f"{scene.strehl.ray_count:,} asked for, {count:,} traced, pupil of {scene.receiver.diameter * 1e3:g} mm",
        ),
        ("predicted", _prediction(plan, count)),
        (
            "rays, OPD map",
            f"{len(sampled):,} for {int(inside.sum()):,} samples, {PUPIL_SAMPLES} across the pupil{shared}",
        ),
        ("rays, picture", f"{FAN_RAYS}, to {FAN_PLANES - 1} planes"),
        (
            "rays, echo",
            f"{scene.beam.ray_count:,} target points; {_way_back(scene, prepared.field)}",
        ),
        ("ranging", f"{scene.detector.ranging}, {scene.detector.sample_rate / 1e9:g} GHz samples"),
    ]
    return rows


def _prediction(plan: TracePlan, ray_count: int) -> str:
    """Cost and error of the Strehl ratio's rays, in words."""
    each, error = plan.predicted_evaluations, plan.predicted_error
    cost = (
        "cost not known before"
        if each is None
        else f"{each:.0f} field evaluations a ray, {each * ray_count:.2g} in all"
    )
    if error is None:
        return f"{cost}; error not known before"
    return f"{cost}; OPD error {error:.1g} waves"


def _way_back(scene: Scene, field: IndexField) -> str:
    """How the light's way back is traced, in words."""
    receiver = scene.receiver
    if receiver.return_factor == "none":
        return "none traced back (return factor none)"
    nodes = receiver.strehl_node_count
    start = f"return factor {receiver.return_factor} at "
    if nodes == "every":
        return f"{start}each of them, {receiver.ray_count:,} rays over the pupil each"
    if is_symmetric(field, target_plane(scene)):
        count = int(nodes) // 2 + 1
        return f"{start}{count} places of a radius, half of {receiver.ray_count:,} rays over the pupil each: symmetric"
    return f"{start}{nodes} x {nodes} places, {receiver.ray_count:,} rays over the pupil each"
