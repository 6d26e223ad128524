"""What can be said of a scene's echo before tracing any ray: the echo in vacuum, and whether it can be ranged."""

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
    vacuum = check_echo(scene, field)
    time, fine, stride = vacuum.times()
    power = vacuum.power(fine)
    fine_voltage = vacuum.chain.voltage(fine, power)
    voltage = fine_voltage[::stride]
    rangefinder = Rangefinder.calibrated(scene, time, voltage, (fine, fine_voltage))
    peak = peak_height(voltage)
    own = scene.detector.ranging
    fixed = own == "leading-edge" and own not in rangefinder.unreadable
    return EchoPrediction(
        peak_height(power[::stride]),
        peak,
        rangefinder.unreadable,
        scene.detector.threshold / peak if fixed else float("nan"),
    )


def check_echo(scene: Scene, field: IndexField | None = None) -> VacuumEcho:
    """What is known of a scene's echo before any ray is traced; a scene that has no echo to compute is refused.

    Raises:
        ValueError: As for `predict_echo`.
    """
    vacuum = VacuumEcho.of(scene)
    vacuum.times()  # refuses what is no record,
    _ = vacuum.point_power  # and this what has no power
    if field is not None and scene.receiver.return_factor != "none":
        check_ahead(field, vacuum.paths.intersection)
    return vacuum
