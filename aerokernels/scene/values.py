"""Types of the values in a scene (quantities with units, whole numbers, shares) and the base class of its tables."""

import typing
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator

from aerokernels.inputs.units import quantity


class Table(BaseModel):
    """Base class of a scene's tables: immutable, and rejects unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    @field_validator("*", mode="before")
    @classmethod
    def _without_zeros(cls, value: Any) -> Any:
        """Reject texts with a zero character, which files and file names cannot hold."""
        if isinstance(value, str) and "\0" in value:
            raise ValueError("a text cannot contain a zero character")
        return value


def key(default: Any, description: str) -> Any:
    """Define a key of a table; a default of `...` makes the key required."""
    return Field(default, description=description)


def measured(dimension: str) -> BeforeValidator:
    """Return a validator that converts a number or a text with a unit into SI, and rejects anything else."""

    def convert(value: Any) -> float:
        try:
            return quantity(value, dimension)
        except TypeError as fault:
            raise ValueError(str(fault)) from None

    convert.dimension = dimension  # type: ignore[attr-defined]  # read by `values.dimension_of`
    return BeforeValidator(convert)


def absent(word: str) -> BeforeValidator:
    """Return a validator that lets a word mean "no value": TOML has no null."""
    return BeforeValidator(lambda value: None if value == word else value)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not float(value).is_integer():
        raise ValueError("give a whole number, such as 1000")
    return int(value)


# Every number has bounds. They are far beyond what is built, and near enough that no result overflows.
Length = Annotated[float, measured("length"), Field(ge=1e-9, le=1e9)]
Coordinate = Annotated[float, measured("length"), Field(ge=-1e9, le=1e9)]
Angle = Annotated[float, measured("angle"), Field(ge=-6.2832, le=6.2832)]  # a turn: more are degrees without a unit
Elevation = Annotated[float, measured("angle"), Field(ge=-1.570797, le=1.570797)]
Time = Annotated[float, measured("time"), Field(ge=1e-18, le=1e9)]
Power = Annotated[float, measured("power"), Field(ge=1e-15, le=1e15)]
Speed = Annotated[float, measured("speed"), Field(ge=1e-9, le=3e8)]
Frequency = Annotated[float, measured("frequency"), Field(ge=1e-3, le=1e18)]
Voltage = Annotated[float, measured("voltage"), Field(ge=1e-12, le=1e9)]
Level = Annotated[float, measured("voltage"), Field(ge=-1e9, le=1e9)]
Temperature = Annotated[float, measured("temperature"), Field(ge=1e-3, le=1e6)]
Pressure = Annotated[float, measured("pressure"), Field(ge=-1e12, le=1e12)]
Density = Annotated[float, measured("density"), Field(ge=1e-12, le=1e5)]
Resistance = Annotated[float, measured("resistance"), Field(ge=1e-6, le=1e15)]
DiodeResponsivity = Annotated[float, measured("photodiode responsivity"), Field(ge=1e-9, le=1e3)]
LightLevel = Annotated[float, measured("power"), Field(ge=0.0, le=1e15)]
Current = Annotated[float, measured("current"), Field(ge=0.0, le=1e6)]
NoiseCurrent = Annotated[float, measured("noise current density"), Field(ge=0.0, le=1.0)]
Responsivity = Annotated[float, measured("responsivity"), Field(ge=1e-9, le=1e15)]
GladstoneDale = Annotated[float, measured("gladstone-dale"), Field(ge=1e-12, le=1.0)]
# The limit is 0.01 degree below a right angle: a target seen edge-on returns nothing and its tangent is infinite.
Tilt = Annotated[float, measured("angle"), Field(gt=-1.5706, lt=1.5706)]
Number = Annotated[float, measured("dimensionless"), Field(ge=1e-12, le=1e12)]
Gain = Annotated[float, measured("dimensionless"), Field(ge=1.0, le=1e9)]
Share = Annotated[float, measured("dimensionless"), Field(ge=1e-12, le=1.0)]
Fraction = Annotated[float, measured("dimensionless"), Field(ge=0.0, le=1.0)]
OpenShare = Annotated[float, measured("dimensionless"), Field(ge=1e-6, lt=1.0)]
Whole = Annotated[int, BeforeValidator(_whole)]
Count = Annotated[int, BeforeValidator(_whole), Field(ge=1, le=10**9)]
PointCount = Annotated[Count, Field(le=10**7)]  # of what is held in memory


def dimension_of(model: Any, key: str) -> str | None:
    """Return a dotted key's dimension, "angle" for "target.tilt"; None if it has no dimension or is unknown."""
    *tables, leaf = key.split(".")
    for name in tables:
        field = getattr(model, "model_fields", {}).get(name)
        model = field.annotation if field is not None else None
    field = getattr(model, "model_fields", {}).get(leaf) if model is not None else None
    if field is None or (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
        return None
    return next(iter(_dimensions([*field.metadata, field.annotation])), None)


def _dimensions(parts: list[Any]) -> list[str]:
    """Collect the dimensions of the validators in an annotation's parts, nested parts included."""
    result = []
    for part in parts:
        if isinstance(part, BeforeValidator):
            result += [name for name in [getattr(part.func, "dimension", None)] if name]
        elif typing.get_args(part):
            result += _dimensions([*typing.get_args(part), *getattr(part, "__metadata__", ())])
    return result
