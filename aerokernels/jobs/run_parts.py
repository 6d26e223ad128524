"""The parts of a run, from which its summary, dataset and report are made."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from aerokernels.display.error_budget import main_cause
from aerokernels.display.verdict import Verdict, judge
from aerokernels.echo import EchoResult
from aerokernels.jobs.views import PupilMap, RayFan, Spot, spot
from aerokernels.prepare import Prepared
from aerokernels.scene import Scene
from aerokernels.strehl import StrehlEstimate


@dataclass(frozen=True, eq=False)
class RunParts:
    """The results of all stages of a run.

    Attributes:
        scene: The scene.
        prepared: Its flow and index fields.
        strehl: The Strehl ratio of a plane wave through the scene's pupil.
        pupil: The optical path difference over the scene's pupil; None if that stage failed.
        fan: Rays for the figures; None if that stage failed.
        echo: The laser echo and its range; None if no light returns.
        seconds: Wall time [s] of each part ("prepare", "strehl", "wavefront", "fan", "echo", "error"), and "total".
        stages: Wall time [s] of the run by activity, such as compiling or running kernels: see STAGES in clock.py.
        failed: The reason for each stage that failed: "wavefront", "rays", "echo".
    """

    scene: Scene
    prepared: Prepared
    strehl: StrehlEstimate
    pupil: PupilMap | None
    fan: RayFan | None
    echo: EchoResult | None
    seconds: Mapping[str, float]
    stages: Mapping[str, float]
    failed: Mapping[str, str] = field(default_factory=dict)

    @property
    def failures(self) -> dict[str, str]:
        """The reason for each stage without a result; "range" is for an echo that cannot be ranged."""
        reason = self.echo.reason if self.echo is not None else None
        return {**self.failed, **({"range": reason} if reason else {})}

    @property
    def verdict(self) -> Verdict:
        """Whether the Strehl ratio and the echo's peak are meaningful given their errors, and why."""
        numbers = {"Strehl ratio": self.strehl.quantities["value"]}
        if self.echo is not None:
            numbers["echo's peak power"] = self.echo.quantities["peak_power"]
        return judge(numbers, main_cause(self.strehl.error))

    @cached_property
    def spot(self) -> Spot | None:
        """The point spread function of the wavefront, if there is one; computed when first read."""
        return None if self.pupil is None else spot(self.pupil, self.scene.flow.wavelength)
