"""Every ray between target points and the pupil, where the package keeps sums over them only."""

import numpy as np

from aerokernels.lidar.parts import Setup
from aerokernels.lidar.return_paths import _trace_rays, check_ahead
from aerokernels.medium import IndexField
from aerokernels.scene import Scene
from aerokernels.tracing import TraceResult


def return_opd(scene: Scene, index: IndexField, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, TraceResult]:
    """Optical path difference of every ray between a few target points and the pupil, for inspection.

    Args:
        scene: The scene; `receiver.ray_count` rays for each point.
        index: The refractive index.
        target: Target points [m], shape (k, 3).

    Returns:
        OPD [m], shape (k, n); shares of the pupil, 0 for rays that did not get out, shape (k, n); the trace.

    Raises:
        ValueError: The target is not ahead of the flow.
    """
    check_ahead(index, target)
    setup = Setup.of_scene(scene)
    start, weight = setup.receiver.pupil.sample(setup.receiver.ray_count, "gauss")
    position, point = np.tile(start, (len(target), 1)), np.repeat(target, len(start), axis=0)
    opd, result = _trace_rays(setup, index, position, point)
    opd = opd.reshape(len(target), -1)
    return opd, np.where(result.ok.reshape(opd.shape), weight, 0.0), result
