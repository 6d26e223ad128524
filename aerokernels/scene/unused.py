"""Name the parts of a scene that have no effect on a command."""

from pydantic import BaseModel

from aerokernels.inputs.checks import warn_caller
from aerokernels.scene.scene import Scene

_LASER = ("atmosphere", "beam", "detector", "strehl", "target")
_STEPS = ("trace.allow_truncation", "trace.max_steps", "trace.method", "trace.step")
# Tables and keys that change no number of a command. The field of `strehl` includes the lines to the target.
UNUSED = {
    "run": ("series",),
    "strehl": ("atmosphere", "detector", "series"),
    "schlieren": (*_LASER, "pupil", "receiver", "series", *_STEPS),
    "series": (*_LASER, "flow.source", "flow.density", "flow.interpolation", "grid", *_STEPS),
}


def warn_of_unused(scene: Scene, command: str) -> None:
    """Warn in one line of the tables and keys that differ from their defaults without an effect on the command.

    A scene without a flow is refused where the flow is read, in one line as well.
    """
    if scene.flow.source is None and command != "series":
        return
    idle = [f"[{name}]" if "." not in name else name for name in UNUSED[command] if _is_set(scene, name)]
    if idle:
        warn_caller(f"{scene.name}: {', '.join(idle)} {'has' if len(idle) == 1 else 'have'} no effect here")


def _is_set(scene: Scene, name: str) -> bool:
    """Whether a table, or a key of a table, differs from its default."""
    table, _, leaf = name.partition(".")
    model: BaseModel = getattr(scene, table)
    if not leaf:
        return model != type(model)()
    return getattr(model, leaf) not in (None, type(model).model_fields[leaf].get_default())
