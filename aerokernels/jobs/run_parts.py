"""What a run made, part by part: the data that summaries, datasets and reports are written from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from aerokernels.echo import EchoResult
from aerokernels.jobs.views import PupilMap, RayFan, Spot, spot
from aerokernels.prepare import Prepared
from aerokernels.scene import Scene
from aerokernels.strehl import StrehlEstimate


@dataclass(frozen=True, eq=False)
class RunParts:
    """Everything that a run made.

    Attributes:
        scene: The scene.
        prepared: Its flow and index fields.
        strehl: The Strehl ratio of the view straight ahead.
        pupil: The optical path difference over the receiver's pupil; None where that stage failed.
        fan: Rays for the picture; None where that stage failed.
        echo: The laser echo and its range; None where no light returns.
        seconds: Wall time of each part ("prepare", "strehl", "wavefront", "fan", "echo", "error"), and "total".
        stages: Wall time of all of it by what was done, kernels compiled or run: see STAGES in clock.py.
        failed: Why, for each stage that failed: "wavefront", "rays", "echo".
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
        """Why there is no result, for each stage without one; "range" is an echo that cannot be ranged."""
        reason = self.echo.reason if self.echo is not None else None
        return {**self.failed, **({"range": reason} if reason else {})}

    @cached_property
    def spot(self) -> Spot | None:
        """The point spread function of the wavefront, where there is one; computed when it is first read."""
        return None if self.pupil is None else spot(self.pupil, self.scene.flow.wavelength)
