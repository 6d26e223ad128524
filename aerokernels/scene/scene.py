"""A scene: the checked description, in SI units, of everything that one run needs; and changes of its keys."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, ValidationError, model_validator

from aerokernels.display.shown import as_html
from aerokernels.flow import (
    SEA_LEVEL_DENSITY,
    DensityField,
    cone,
    standard_atmosphere,
    uniform_air,
)
from aerokernels.flow.sampled_density import SampledDensity
from aerokernels.flow.shipped import shipped, shipped_names
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import quantity, si_unit
from aerokernels.pupils import Pupil
from aerokernels.scene.echo_tables import AtmosphereTable, BeamTable, DetectorTable, ReceiverTable, TargetTable
from aerokernels.scene.loading import (
    override,
    read_scene,
    read_summary,
    resolve_paths,
    scene_error,
    toml_value,
)
from aerokernels.scene.pupil_table import PupilTable
from aerokernels.scene.tables import CONE, STATIC, FlowTable, GridTable, SeriesTable, StrehlTable, TraceTable
from aerokernels.scene.values import Table, dimension_of


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
        if self.flow.is_mixture and self.flow.source in (*shipped_names(), STATIC, CONE):
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
        """Read a scene file, the scene of a finished run, or a shipped scene by its name.

        Args:
            place: Path of a TOML file or of a run's summary.json, or a name from `shipped_scenes()`.
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
        tables = read_summary(place)
        try:
            return cls.model_validate(tables)
        except ValidationError as fault:
            raise scene_error(fault, tables, str(place), (), cls) from None

    def _repr_html_(self) -> str:
        lines = []
        for name, value in self.model_dump(mode="json", exclude_unset=True).items():
            keys = {f"{name}.{key}": one for key, one in value.items()} if isinstance(value, Mapping) else {name: value}
            for key, one in keys.items():
                unit = key_unit(key) if isinstance(one, float) else "1"
                lines.append(f"  {key}: {one}{'' if unit == '1' else f' {unit}'}")
        try:
            picture = self.density_field()._picture()
        except (ValueError, OSError):  # a flow that is not there, or snapshots alone
            picture = None
        return as_html("\n".join(["Scene", *lines]), picture)

    def density_field(self) -> DensityField:
        """Return the scene's flow at its density; "static" is air at rest around the model, by default at sea level.

        Raises:
            ValueError: A scene of snapshots alone, or a flow file that cannot be used; one line that names the place
                and the remedy.
        """
        source, altitude = self.flow_source, self.flow.altitude
        own = self.flow.density == "tunnel" and altitude is None
        if altitude is not None:
            density = standard_atmosphere(altitude).density
        else:
            density = SEA_LEVEL_DENSITY if isinstance(self.flow.density, str) else self.flow.density
        if source == CONE:
            return cone(float(self.flow.mach or 0.0), float(self.flow.half_angle or 0.0), density=density)
        if source == STATIC:
            return uniform_air(density, body=shipped(shipped_names()[0]).body)
        if source in shipped_names():
            field: DensityField = shipped(source)
        else:
            from aerokernels.flow import read

            field = read(Path(source).expanduser(), species=self.flow.species, **self.flow.file.read_options())
        try:
            field = field if own else field.scaled(density)
        except ValueError as fault:
            raise ValueError(f"flow.density = {density:g} kg/m3: {fault}") from None
        if altitude is not None and isinstance(field, SampledDensity):
            said = f"{field.provenance}, to the US Standard Atmosphere 1976 at {altitude / 1e3:g} km"
            return replace(field, provenance=said)  # type: ignore[type-var]
        return field

    def as_dict(self) -> dict[str, Any]:
        """Return all values, defaults included, in SI units, as plain JSON types: the provenance in results."""
        return self.model_dump(mode="json")


def changed_scene(scene: Scene | str | Path, changes: Mapping[str, Any]) -> Scene:
    """Return a scene with other values by dotted key, checked as a scene file is."""
    if not isinstance(scene, Scene):
        return Scene.load(scene, changes)
    tables = _without_none(scene.model_dump(mode="json", exclude_unset=True))
    override(tables, changes, scene.name)
    try:
        return Scene.model_validate(tables)
    except ValidationError as fault:
        raise scene_error(fault, tables, scene.name, changes, Scene) from None


def key_dimension(key: str) -> str | None:
    """Return a key's dimension, "angle" for "target.tilt"; None for a key without a dimension or an unknown key."""
    return dimension_of(Scene, key)


def key_unit(key: str) -> str:
    """Return the SI unit of a scene's key; "1" for a key without a dimension or a dimensionless number."""
    dimension = key_dimension(key)
    return (si_unit(dimension) or "1") if dimension else "1"


def key_value(key: str, value: Any) -> Any:
    """Return a key's value in its plainest form: a quantity as an SI number, a TOML text as the value it denotes.

    The scene, not this function, checks whether the key accepts the value.
    """
    if isinstance(value, str):
        dimension = key_dimension(key)
        if dimension is not None:
            try:
                return quantity(value, dimension)
            except ValueError:
                return value  # a word such as "tunnel", or an invalid value that the scene rejects
        return toml_value(value)
    return value


def with_units(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Write the SI numbers of quantities as texts such as "0.2 rad", so that an error about a value shows its unit."""
    result = dict(changes)
    for key, value in changes.items():
        unit = key_unit(key)
        if unit != "1" and isinstance(value, (int, float)) and not isinstance(value, bool):
            result[key] = f"{float(value)!r} {unit}"
    return result


def _without_none(values: Mapping[str, Any]) -> dict[str, Any]:
    """Drop keys without a value: TOML has no null, and an absent key means the same."""
    return {
        key: _without_none(value) if isinstance(value, Mapping) else value
        for key, value in values.items()
        if value is not None
    }


_LASER = ("atmosphere", "beam", "detector", "strehl", "target")
_STEPS = ("trace.allow_truncation", "trace.max_steps", "trace.method", "trace.step")
# Tables and keys that change no number of a command. The field of `strehl` includes the lines to the target.
UNUSED = {
    "run": ("series",),
    "strehl": ("atmosphere", "detector", "series"),
    "schlieren": (*_LASER, "pupil", "receiver", "series", *_STEPS),
    "series": (*_LASER, "flow.source", "flow.density", "flow.altitude", "flow.interpolation", "grid", *_STEPS),
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
