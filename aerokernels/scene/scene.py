"""A scene: the checked description, in SI units, of everything that one run needs."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, model_validator

from aerokernels.flow import SEA_LEVEL_DENSITY, DensityField, read, shipped, shipped_names, uniform_air
from aerokernels.inputs.arguments import checked
from aerokernels.pupils import Pupil
from aerokernels.scene.echo_tables import AtmosphereTable, BeamTable, DetectorTable, ReceiverTable, TargetTable
from aerokernels.scene.errors import SceneError, scene_error
from aerokernels.scene.loading import override, read_scene, resolve_paths
from aerokernels.scene.pupil_table import PupilTable
from aerokernels.scene.tables import STATIC, FlowTable, GridTable, SeriesTable, StrehlTable, TraceTable
from aerokernels.scene.values import Table


class Scene(Table):
    """The scene that a user describes in a TOML file. Loaded numbers are SI.

    The keys are defined in tables.py, echo_tables.py, pupil_table.py and detector_table.py.
    """

    name: str = Field("scene", description="Short name for files and tables; the file's name if absent.")
    title: str = Field("", description="One line for the report.")
    flow: FlowTable
    grid: GridTable = GridTable()
    beam: BeamTable = BeamTable()
    target: TargetTable = TargetTable()
    receiver: ReceiverTable = ReceiverTable()
    pupil: PupilTable = PupilTable()
    atmosphere: AtmosphereTable = AtmosphereTable()
    detector: DetectorTable = DetectorTable()
    strehl: StrehlTable = StrehlTable()
    trace: TraceTable = TraceTable()
    series: SeriesTable = SeriesTable()

    @model_validator(mode="before")
    @classmethod
    def _series_alone(cls, values: Any) -> Any:
        """Let a scene of snapshots leave out [flow].source, which is then None."""
        series = values.get("series") if isinstance(values, dict) else None
        if isinstance(series, dict) and series.get("source"):
            flow = values.get("flow", {})
            return {**values, "flow": {"source": None, **flow}} if isinstance(flow, dict) else values
        return values

    @model_validator(mode="after")
    def _pupil_can_be_made(self) -> "Scene":
        _ = self.view
        return self

    @model_validator(mode="after")
    def _species_have_a_file(self) -> "Scene":
        if self.flow.is_mixture and self.flow.source in (*shipped_names(), STATIC):
            raise ValueError(f"flow.species needs a flow file, and {self.flow.source!r} is air: leave the key out")
        return self

    @property
    def view(self) -> Pupil:
        """The pupil through which the flow is viewed, at its place and in its direction: [pupil], or the receiver's."""
        return self.pupil.to_pupil(self.receiver)

    @property
    def has_own_pupil(self) -> bool:
        """Whether [pupil] defines another pupil than the receiver's."""
        return self.pupil != PupilTable()

    @property
    def flow_source(self) -> str:
        """The name or the file of the scene's flow.

        Raises:
            ValueError: A scene of snapshots alone.
        """
        if self.flow.source is None:
            raise ValueError(
                "flow.source is missing: the snapshots of [series] are for `aerokernels series` alone; add a table "
                '[flow] with source, such as "mach3", a flow file, or "static" for air at rest'
            )
        return self.flow.source

    @classmethod
    @checked
    def load(cls, place: str | Path, overrides: Mapping[str, Any] | None = None) -> "Scene":
        """Read a scene file, or a shipped scene by its name.

        Args:
            place: Path of a TOML file, or a name from `shipped_scenes()`.
            overrides: Values that replace the file's, by dotted key: {"target.distance": "1.2 m"}. A text that is a
                TOML value ("1e-4", '["piston", "tilt"]') is parsed, any other stays a text.

        Raises:
            SceneError: Anything wrong with the file or the overrides, in one line: file, key, value, remedy.
        """
        if not isinstance(overrides, (Mapping, type(None))):
            raise TypeError(f"overrides must map dotted keys to values, {{'target.tilt': 0}}, got {overrides!r}")
        label, name, tables = read_scene(place)
        changes = dict(overrides or {})
        resolve_paths(tables, place)
        tables.setdefault("name", name)
        override(tables, changes, label)
        try:
            return cls.model_validate(tables)
        except ValidationError as fault:
            raise scene_error(fault, tables, label, changes, cls) from None

    @classmethod
    @checked
    def from_summary(cls, path: str | Path) -> "Scene":
        """Return the scene of a finished run.

        Args:
            path: The run's summary.json, or its folder.

        Raises:
            SceneError: A file that does not exist, or is not the summary of a run by this version.
        """
        place = Path(path) / "summary.json" if Path(path).is_dir() else Path(path)
        try:
            tables = json.loads(place.read_text(encoding="utf-8"))["scene_values"]
            return cls.model_validate(tables)
        except OSError as fault:
            raise SceneError(f"{place}: cannot be read, {fault.strerror}: give the summary.json of a run") from None
        except ValidationError as fault:
            raise scene_error(fault, tables, str(place), (), cls) from None
        except (ValueError, KeyError, TypeError):
            raise SceneError(f"{place}: holds no values of a scene: give the summary.json of a run") from None

    def density_field(self) -> DensityField:
        """Return the scene's flow at its density; "static" is air at rest around the model, by default at sea level.

        Raises:
            ValueError: A scene of snapshots alone, or a flow file that cannot be used; one line that names the place
                and the remedy.
        """
        source, own = self.flow_source, self.flow.density == "tunnel"
        density = SEA_LEVEL_DENSITY if self.flow.density == "sea-level" or own else float(self.flow.density)
        if source == STATIC:
            return uniform_air(density, body=shipped(shipped_names()[0]).body)
        field = (
            shipped(source)
            if source in shipped_names()
            else read(Path(source).expanduser(), species=self.flow.species, **self.flow.file.read_options())
        )
        try:
            return field if own else field.scaled(density)
        except ValueError as fault:
            raise ValueError(f"flow.density = {density:g} kg/m3: {fault}") from None

    def as_dict(self) -> dict[str, Any]:
        """Return all values, defaults included, in SI units, as plain JSON types: the provenance in results."""
        return self.model_dump(mode="json")


__all__ = ["Scene", "SceneError"]
