"""[pupil]: the aperture through which the flow is viewed, and its direction of view. Defaults as in tables.py."""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator

from aerokernels.inputs.units import quantity
from aerokernels.pupils import Annulus, Disc, Polygon, Pupil, Rectangle, direction_of
from aerokernels.scene.echo_tables import ReceiverTable
from aerokernels.scene.values import Angle, Elevation, Length, Table, key

# The size keys of each shape.
SIZES = {
    "disc": ("diameter",),
    "annulus": ("diameter", "inner_diameter"),
    "rectangle": ("width", "height"),
    "polygon": ("vertices",),
}


def _point(value: Any, count: int, example: str) -> tuple[float, ...]:
    if not isinstance(value, (list, tuple)) or len(value) != count:
        raise ValueError(f"give {count} lengths in brackets, such as {example}")
    try:
        result = tuple(quantity(part, "length") for part in value)
    except TypeError as fault:
        raise ValueError(str(fault)) from None
    if any(abs(part) > 1e9 for part in result):
        raise ValueError("each length must be at most 1e+09 m")
    return result


def _center(value: Any) -> tuple[float, ...]:
    return _point(value, 3, '["0 mm", "2 mm", "-8 mm"]')


def _vertices(value: Any) -> tuple[tuple[float, ...], ...]:
    example = '[["-4 mm", "-3 mm"], ["4 mm", "-3 mm"], ["0 mm", "5 mm"]]'
    if not isinstance(value, (list, tuple)) or len(value) < 3:
        raise ValueError(f"give three corners or more, such as {example}")
    return tuple(_point(corner, 2, '["-4 mm", "-3 mm"], for each corner') for corner in value)


def _lengths(convert: Callable[[Any], Any]) -> BeforeValidator:
    def converted(value: Any) -> Any:
        return None if value is None else convert(value)

    converted.dimension = "length"  # type: ignore[attr-defined]  # read by `values.dimension_of`
    return BeforeValidator(converted)


class PupilTable(Table):
    """[pupil]: the pupil of Strehl ratio, wavefront and snapshots; keys left out are taken from [receiver].

    The echo is always collected by the pupil of [receiver].
    """

    shape: Literal["disc", "annulus", "rectangle", "polygon"] | None = key(
        None,
        'Shape of the pupil: "disc", of pupil.diameter; "annulus", with a central obstruction of pupil.inner_diameter; '
        '"rectangle", of pupil.width and pupil.height; "polygon", of pupil.vertices. Absent: a disc where a diameter '
        "is given, else shape and size of [receiver].",
    )
    diameter: Length | None = key(None, 'Diameter, for shape "disc" and "annulus"; receiver.diameter if absent.')
    inner_diameter: Length | None = key(None, 'Diameter of the central obstruction, for shape "annulus".')
    width: Length | None = key(
        None,
        'Extent along the pupil\'s first axis, which is x where it looks ahead, for shape "rectangle"; '
        "receiver.diameter if absent.",
    )
    height: Length | None = key(
        None, 'Extent along its second axis, y where it looks ahead, for shape "rectangle"; a square if absent.'
    )
    vertices: Annotated[tuple[tuple[float, float], ...] | None, _lengths(_vertices)] = key(
        None,
        'Corners in cyclic order, for shape "polygon": pairs of lengths along the pupil\'s two axes from its centre, '
        "such as [['-4 mm', '-3 mm'], ['4 mm', '-3 mm'], ['0 mm', '5 mm']].",
    )
    center: Annotated[tuple[float, float, float] | None, _lengths(_center)] = key(
        None,
        "The pupil's centre (x, y, z), as ['0 mm', '2 mm', '-8 mm']; on the axis at receiver.aperture_z if absent.",
    )
    azimuth: Angle = key(
        "0 deg", "Direction of view: the angle by which the pupil is turned from straight ahead, +z, toward +x."
    )
    elevation: Elevation = key(
        "0 deg",
        "The angle by which the pupil is turned toward +y, from -90 to 90 deg. The direction of view is "
        "(sin azimuth cos elevation, sin elevation, cos azimuth cos elevation).",
    )

    @property
    def kind(self) -> str | None:
        """The pupil's shape; None for the receiver's shape."""
        return self.shape or ("disc" if self.diameter is not None else None)

    def to_pupil(self, receiver: ReceiverTable) -> Pupil:
        """Return the pupil at its place and in its direction; keys left out are taken from `receiver`.

        Raises:
            ValueError: Keys that do not go together, or sizes that make no shape; the message names the keys.
        """
        self._check_sizes()
        middle = (0.0, 0.0, receiver.aperture_z) if self.center is None else self.center
        place = {"center": np.array(middle), "normal": direction_of(self.azimuth, self.elevation)}
        diameter = receiver.diameter if self.diameter is None else self.diameter
        if self.kind == "annulus":
            inner = self.inner_diameter
            if inner is None:
                raise ValueError('pupil.shape = "annulus" needs pupil.inner_diameter: add a length such as "4 mm"')
            if inner >= diameter:
                raise ValueError(
                    f"pupil.inner_diameter, {inner:g} m, must be below the pupil's diameter, {diameter:g} m"
                )
            return Annulus(0.5 * diameter, 0.5 * inner, **place)
        if self.kind == "rectangle":
            width = receiver.diameter if self.width is None else self.width
            return Rectangle(width, width if self.height is None else self.height, **place)
        if self.kind == "polygon":
            if self.vertices is None:
                raise ValueError('pupil.shape = "polygon" needs pupil.vertices, its corners in cyclic order')
            try:
                return Polygon(np.array(self.vertices), **place)
            except ValueError as fault:
                raise ValueError(f"pupil.vertices: {fault}") from None
        return Disc(0.5 * diameter, **place) if self.kind == "disc" else replace(receiver.pupil, **place)  # type: ignore[type-var]

    def _check_sizes(self) -> None:
        for name in ("diameter", "inner_diameter", "width", "height", "vertices"):
            if getattr(self, name) is None or name in SIZES.get(self.kind or "", ()):
                continue
            shape = next(shape for shape, sizes in SIZES.items() if name in sizes)
            raise ValueError(
                f'pupil.{name} belongs to shape = "{shape}"'
                + (f", not to {self.shape!r}" if self.shape else f': add shape = "{shape}" to [pupil]')
            )


def axis_words(pupil: Pupil) -> tuple[str, str]:
    """Return names of a pupil's two axes: x and y for a pupil that faces +z, else the pupil's own axes 1 and 2."""
    return ("x", "y") if pupil.axes[0][0] == pupil.axes[1][1] == 1.0 else ("the pupil's axis 1", "the pupil's axis 2")


def in_words(pupil: Pupil) -> str:
    """Describe a pupil's shape, size, place and direction, in mm and degrees."""
    width, height = (2e3 * extent for extent in pupil.half_extent)
    size = {
        "Disc": f"pupil of {width:g} mm",
        "Annulus": f"annulus of {width:g} mm, {width * (pupil.inner_ratio or 0.0):g} mm inside",
        "Rectangle": f"rectangle of {width:g} x {height:g} mm",
    }.get(type(pupil).__name__, f"{type(pupil).__name__.lower()} of {1e6 * pupil.area:g} mm2")
    words = [size]
    if np.any(pupil.center[:2]):
        words.append("centre at " + ", ".join(f"{1e3 * part:g}" for part in pupil.center) + " mm")
    if np.any(pupil.normal[:2]) or pupil.normal[2] < 0.0:
        azimuth = np.degrees(np.arctan2(pupil.normal[0], pupil.normal[2]))
        elevation = np.degrees(np.arcsin(np.clip(pupil.normal[1], -1.0, 1.0)))
        words.append(f"looking to azimuth {azimuth:.4g} deg, elevation {elevation:.4g} deg")
    return ", ".join(words)
