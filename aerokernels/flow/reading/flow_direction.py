"""Compare the direction of a file's velocity with the optical axis that is taken where the caller gives no frame.

Without a frame the optical axis is expected to point upstream, and the ambient density is that of the air at its end. A
file whose flow runs elsewhere is read all the same: the provenance says so, and a warning where it runs the other way.
"""

from collections.abc import Mapping

import numpy as np

from aerokernels.inputs.checks import warn_caller

from .array_names import plain_name
from .dataset import Dataset, ReadError
from .frame import Frame

VECTORS = ("u", "velocity", "velocityvector", "umean", "momentum", "rhou")
COMPONENTS = (
    ("velocityx", "velocityy", "velocityz"), ("xvelocity", "yvelocity", "zvelocity"), ("velx", "vely", "velz"),
    ("momentumx", "momentumy", "momentumz"), ("xmomentum", "ymomentum", "zmomentum"),
    ("u", "v", "w"), ("ux", "uy", "uz"), ("vx", "vy", "vz"), ("rhou", "rhov", "rhow"),
)  # fmt: skip
AGAINST = -0.5  # cosine of the greatest angle between the velocity and the direction against the axis: 60 degrees
STEADY = 0.3  # of the mean speed: a mean velocity below it has no direction, as in a closed room


def direction_note(path, dataset: Dataset, frame: Frame, axes: np.ndarray) -> list[str]:
    """Return a note if the file's velocity does not run against the optical axis; else nothing.

    A velocity along the axis is warned of; across it, it may be meant.

    Args:
        path: The file, for the warning.
        dataset: The file's contents.
        frame: The caller's frame; one with an optical axis needs no note.
        axes: x, y, z of the optical frame in the file's axes, as rows, shape (3, 3).
    """
    if frame.look is not None or (found := _mean_velocity(dataset)) is None:
        return []
    name, velocity = found
    if velocity @ axes[2] < AGAINST:
        return []
    along = int(np.argmax(np.abs(velocity)))
    said = f"{'-' if velocity[along] < 0.0 else '+'}{'xyz'[along]}"
    note = (
        f"the flow runs along {said} by its {name!r}, which is not against the optical axis: with flow = {said!r} in "
        "the frame it is, and the ambient density is taken upstream"
    )
    if velocity @ axes[2] > -AGAINST:
        warn_caller(f"{path}: {note}")
    return [note]


def _mean_velocity(dataset: Dataset) -> tuple[str, np.ndarray] | None:
    """Return the name and the direction of the mean velocity or momentum; None if none is known."""
    total, speed, called = np.zeros(3), 0.0, ""
    with np.errstate(over="ignore", invalid="ignore"):  # damaged numbers, which are not those of the density
        for block in dataset.blocks:
            for arrays in (block.cell_data, block.point_data):
                if (found := _velocity(arrays)) is None:
                    continue
                called, own = found
                own = own[np.isfinite(own).all(axis=1)]
                total += own.sum(axis=0)
                speed += float(np.linalg.norm(own, axis=1).sum())
                break
        size = float(np.linalg.norm(total))
    return (called, total / size) if called and STEADY * speed < size < np.inf else None


def _velocity(arrays: Mapping[str, np.ndarray]) -> tuple[str, np.ndarray] | None:
    names = {plain_name(name): name for name in reversed([*arrays])}
    try:
        for name in (names[one] for one in VECTORS if one in names):
            values = np.asarray(arrays[name])
            if values.ndim == 2 and values.shape[1] in (2, 3) and values.dtype.kind == "f":
                return name, np.pad(values.astype(np.float64), ((0, 0), (0, 3 - values.shape[1])))
    except ReadError:  # a damaged field that the density does not need
        return None
    for parts in COMPONENTS:
        held = {one: np.asarray(arrays[names[one]]) for one in parts if one in names}
        if (
            parts[0] not in held
            or len(held) < 2
            or any(own.ndim != 1 or own.dtype.kind != "f" for own in held.values())
        ):
            continue
        if len({len(own) for own in held.values()}) == 1:
            nothing = np.zeros(len(held[parts[0]]))
            return names[parts[0]], np.stack([held.get(one, nothing) for one in parts], axis=1, dtype=np.float64)
    return None
