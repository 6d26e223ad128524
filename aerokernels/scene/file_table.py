"""The table [flow.file] of a scene: what a user's own flow file means where it does not say so itself."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from aerokernels.scene.values import Angle, Density, Length, Number, Pressure, Table, Temperature, key


def _axis(value: str) -> str:
    from aerokernels.flow.reading.frame import direction

    direction(value, "axis")
    return value


def _length_unit(value: Any) -> str | None:
    if value is None:
        return None
    from aerokernels.flow.reading.read import unit_of_length

    if not isinstance(value, (str, float, int)) or isinstance(value, bool):
        raise ValueError("give a unit such as 'mm', or a length such as '2.5 mm'")
    unit_of_length(value)
    return str(value) if isinstance(value, str) else f"{value} m"


def _time(value: Any) -> str | float:
    if value in ("latest", "first"):
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < float("inf"):
        raise ValueError("give 'latest', 'first' or one of the file's times in seconds")
    return float(value)


Axis = Annotated[str, AfterValidator(_axis)]
Place = Annotated[float, Field(ge=-1e12, le=1e12)]


class FileTable(Table):
    """[flow.file]: the meaning of a user's flow file; every key may be left out where the file itself tells."""

    density: str | None = key(None, "Name of the density's array; if absent, usual names are tried.")
    pressure: str | None = key(None, "Name of the pressure's array; with flow.file.temperature it gives the density.")
    temperature: str | None = key(
        None, "Name of the temperature's array; with flow.file.pressure it gives the density."
    )
    gas_constant: Number | None = key(
        None,
        "Gas constant [J/(kg K)] for the density from both; if absent, the file's or that of dry air.",
    )
    optical: Axis | None = key(None, 'The optical axis in the file\'s axes: "-x" looks against a flow along +x.')
    up: Axis | None = key(None, "Direction of +y in the file's axes, at right angles to the optical axis.")
    origin: tuple[Place, Place, Place] = key(
        (0.0, 0.0, 0.0), "The point of the file that becomes the origin, in the file's unit of length."
    )
    rotation: Angle = key("0 deg", "Angle about x by which the optical axis is turned toward up.")
    length_unit: Annotated[str | None, BeforeValidator(_length_unit)] = key(
        None, "Unit of the file's coordinates; if absent, the unit that the file states, else metres."
    )
    reference_density: Density | None = key(None, "Density of the value 1 in a non-dimensional file.")
    reference_pressure: Pressure | None = key(None, "Pressure of the value 1 in a non-dimensional file.")
    reference_temperature: Temperature | None = key(None, "Temperature of the value 1 in a non-dimensional file.")
    reference_length: Length | None = key(None, "Length of the value 1 in a non-dimensional file.")
    operating_pressure: Pressure | None = key(
        None, "The pressure to which the file's pressures are relative (gauge pressures); if absent, they are absolute."
    )
    time: Annotated[str | float, BeforeValidator(_time)] = key("latest", '"latest", "first" or a time [s].')
    geometry: Literal["planar", "axisymmetric", "volume"] | None = key(
        None,
        '"axisymmetric" for a plane file whose x is the axis and whose y is the radius; if absent, the file tells.',
    )
    ambient_density: Density | None = key(None, "Density around the field; if absent, that of the oncoming flow.")
    walls: tuple[str, ...] | None = key(
        None, "Names of the boundary patches of the body; if absent, the patches that the file marks as walls."
    )
    spacing: Length | None = key(None, "Greatest node spacing of the grid to which a volume is resampled.")
    mesh: str | None = key(None, "The mesh that belongs to an SU2 restart file.")
    solution: str | None = key(None, "The solution that belongs to a Plot3D grid.")
    order: str | None = key(
        None,
        'The axes of the arrays in an NPZ or HDF5 file, such as "yx" for those of numpy.meshgrid; if absent, lengths '
        "tell, or else they are taken in the order x, y, z, or r, z, with a warning.",
    )

    @model_validator(mode="after")
    def _density_from_one_source(self) -> "FileTable":
        if (self.pressure is None) != (self.temperature is None):
            raise ValueError("flow.file.pressure and flow.file.temperature go together: name both arrays")
        if self.density is not None and self.pressure is not None:
            raise ValueError(
                "flow.file.density excludes flow.file.pressure and flow.file.temperature: drop the one or the others"
            )
        return self

    def read_options(self) -> dict[str, Any]:
        """Return the keyword arguments for `flow.read`."""
        density: Any = self.density
        if self.pressure is not None:
            density = {"pressure": self.pressure, "temperature": self.temperature}
        names = ("density", "pressure", "temperature", "length")
        reference = {name: getattr(self, f"reference_{name}") for name in names}
        reference["operating_pressure"] = self.operating_pressure
        references = {name: value for name, value in reference.items() if value is not None}
        options = {
            "density": density,
            "frame": {"optical": self.optical, "up": self.up, "origin": self.origin, "rotation": self.rotation},
            "length_unit": self.length_unit,
            "reference": references or None,
            "time": self.time,
            "gas_constant": self.gas_constant,
            "geometry": self.geometry,
            "ambient_density": self.ambient_density,
            "walls": self.walls,
            "spacing": self.spacing,
        }
        companions = {"mesh": self.mesh, "solution": self.solution, "order": self.order}
        return options | {name: value for name, value in companions.items() if value is not None}
