"""What can be said of a scene's echo before tracing any ray: the echo in vacuum, and whether it can be ranged."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..scene import Scene
from .chain import chain_of
from .pulse_curve import peak_height
from .pupil_reduction import check_ahead
from .rangefinder import Rangefinder
from .received_power import point_power
from .simulate import vacuum_record, vacuum_times


@dataclass(frozen=True)
class EchoPrediction:
    """A scene's echo in vacuum.

    Attributes:
        peak_power: Its peak power [W].
        peak_voltage: Its peak voltage [V].
        reasons: For each ranging method that cannot read this echo, the reason. The scene has no range by it either.
        least_factor: What the flow must leave of the light, 0 to 1, for the scene's own method to find the echo; NaN
            where that method does not depend on the amplitude, or finds none even in vacuum.
    """

    peak_power: float
    peak_voltage: float
    reasons: Mapping[str, str]
    least_factor: float


def predict_echo(scene: Scene, field: IndexField | None = None) -> EchoPrediction:
    """The echo of a scene in vacuum, which costs no rays.

    Args:
        scene: The scene.
        field: The refractive index, to check that the target lies ahead of it; None: not checked.

    Raises:
        ValueError: A scene that has no echo to compute: a target that reaches back to the aperture or into the flow's
            box, one too deep for its pulse, or a record of millions of samples.
    """
    check_echo(scene, field)
    time, power, voltage, fine = vacuum_record(scene)
    rangefinder = Rangefinder.calibrated(scene, time, voltage, fine)
    peak = peak_height(voltage)
    own = scene.detector.ranging
    fixed = own == "leading-edge" and own not in rangefinder.unreadable
    return EchoPrediction(
        peak_height(power),
        peak,
        rangefinder.unreadable,
        scene.detector.threshold / peak if fixed else float("nan"),
    )


def check_echo(scene: Scene, field: IndexField | None = None) -> None:
    """Refuse a scene that has no echo to compute.

    Raises:
        ValueError: As for `predict_echo`.
    """
    _, points, vacuum, _ = vacuum_times(scene)
    point_power(scene, points.weight, vacuum, np.ones(len(points.weight)))  # refuses what has no power
    chain_of(scene)
    if field is not None and scene.receiver.return_factor != "none":
        check_ahead(field, vacuum.intersection)
