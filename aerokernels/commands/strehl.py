"""`aerokernels strehl`: compute the Strehl ratio alone."""

from aerokernels.commands._scene import Backend, Device, Precision, Rays, SceneName, Settings, load_scene, naming_scene


def strehl(
    scene: SceneName,
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    rays: Rays = None,
    settings: Settings = None,
) -> None:
    """Print the Strehl ratio with its error: 0.9779 +- 0.0041.

    It is that of a plane wave through the scene's pupil, from the direction in which the pupil looks. Computing the
    error takes some hundred more rays, less than a second. Exit status 3: the error allows any ratio from 0
    to 1.
    """
    from aerokernels.commands._output import result
    from aerokernels.commands._verdict import leave_with
    from aerokernels.jobs.run import scene_strehl
    from aerokernels.prepare import prepare_field
    from aerokernels.scene import warn_of_unused

    loaded = load_scene(scene, backend, device, precision, rays, settings)
    warn_of_unused(loaded, "strehl")
    with naming_scene(scene):
        estimate = scene_strehl(loaded, prepare_field(loaded).field)
    found = estimate.quantities
    numbers = {name: {"value": one.value, "error": one.error, "unit": one.unit} for name, one in found.items()}
    result(str(found["value"]), {"scene": loaded.name, **numbers, "verdict": estimate.verdict.level})
    leave_with(estimate.verdict)
