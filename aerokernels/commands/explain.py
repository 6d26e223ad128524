"""`aerokernels explain`: show what a run would do, without running it."""

from aerokernels.commands._scene import Backend, Device, Precision, Rays, SceneName, Settings, load_scene, naming_scene


def explain(
    scene: SceneName,
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    rays: Rays = None,
    settings: Settings = None,
) -> None:
    """Show what a run would do, and why.

    Flow, region, grid, method, ray counts, predicted cost and errors.
    """
    from aerokernels.commands._table import print_table
    from aerokernels.jobs.explain import explanation
    from aerokernels.scene import warn_of_unused

    loaded = load_scene(scene, backend, device, precision, rays, settings)
    warn_of_unused(loaded, "run")
    with naming_scene(scene):
        rows = explanation(loaded)
    print_table(f"What `aerokernels run {scene}` would do", ("what", "how"), rows)
