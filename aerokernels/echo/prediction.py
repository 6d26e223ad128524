"""Predict a scene's echo without tracing rays: the echo in vacuum, and whether each method can read a range from it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..medium import IndexField
from ..scene import Scene
from .pulse_curve import peak_height
from .pupil_reduction import check_ahead
from .rangefinder import Rangefinder
from .vacuum import VacuumEcho


@dataclass(frozen=True)
class EchoPrediction:
    """A scene's echo in vacuum.

    Attributes:
        peak_power: Its peak power [W].
        peak_voltage: Its peak voltage [V].
        reasons: For each ranging method that cannot read this echo, the reason. The scene's echo through the flow has
            no range by that method either.
        least_factor: Least return factor, 0 to 1, with which the scene's own method still finds the echo; NaN if that
            method does not depend on the amplitude, or finds no echo even in vacuum.
    """

    peak_power: float
    peak_voltage: float
    reasons: Mapping[str, str]
    least_factor: float


def predict_echo(scene: Scene, field: IndexField | None = None) -> EchoPrediction:
    """Compute the echo of a scene in vacuum, without tracing rays.

    Args:
        scene: The scene.
        field: The refractive index, to check that the target is ahead of it; None: not checked.

    Raises:
        ValueError: A scene whose echo cannot be computed: a target that reaches back to the aperture or into the flow's
            box, one too deep for its pulse, or a record of millions of samples.
    """
    vacuum = check_echo(scene, field)
    time, fine, stride = vacuum.times()
    power = vacuum.power(fine)
    fine_voltage = vacuum.chain.voltage(fine, power)
    voltage = fine_voltage[::stride]
    rangefinder = Rangefinder.calibrated(scene, time, voltage, (fine, fine_voltage))
    own, least_factor = scene.detector.ranging, math.nan
    if own == "leading-edge" and own not in rangefinder.unreadable:
        # The voltage without saturation, because it is proportional to the light.
        least_factor = scene.detector.threshold / peak_height(vacuum.chain.linear_voltage(fine, power)[::stride])
    return EchoPrediction(peak_height(power[::stride]), peak_height(voltage), rangefinder.unreadable, least_factor)


def check_echo(scene: Scene, field: IndexField | None = None) -> VacuumEcho:
    """Return the echo of a scene in vacuum, after checking that the scene's echo can be computed.

    Raises:
        ValueError: As for `predict_echo`.
    """
    vacuum = VacuumEcho.of(scene)
    vacuum.times()  # raises for a record of too many samples
    _ = vacuum.point_power  # raises for a receiver wider than its distance
    if field is not None and scene.receiver.return_factor != "none":
        check_ahead(field, vacuum.paths.intersection)
    return vacuum
