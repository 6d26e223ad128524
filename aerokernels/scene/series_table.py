"""The [series] table of a scene: snapshots of a flow in time. Defaults as in tables.py."""

from typing import Annotated, Literal

from pydantic import Field

from aerokernels.scene.values import Angle, Count, Density, Elevation, Length, Speed, Table, Time, key


class SeriesTable(Table):
    """[series]: snapshots of a flow in time, for `aerokernels series`; no other command uses this table."""

    source: str | None = key(
        None,
        "A NetCDF file or a Zarr store with a time axis, or a pattern of numbered files; relative to the scene's file.",
    )
    density: str | None = key(None, "Name of the density in the file; if absent, density, rho and the like are tried.")
    ambient_density: Density | None = key(
        None, "Density around the field; the file's attribute ambient_density if absent."
    )
    time_step: Time | None = key(
        None, "Time from one snapshot to the next; in place of the times that a file has of its own."
    )
    azimuth: Angle | None = key(
        None, "Angle toward +x at which the rays leave the pupil, without turning the pupil; pupil.azimuth if absent."
    )
    elevation: Elevation | None = key(
        None, "Angle toward +y at which the rays leave the pupil; pupil.elevation if absent."
    )
    pixel_count: Annotated[Count, Field(ge=2, le=10_000)] = key(64, "Pixels across the pupil.")
    remove: tuple[Literal["piston", "tilt"], ...] = key(("piston", "tilt"), "Terms that are removed from each map.")
    velocity: Speed | None = key(None, "Speed in the Strouhal number, 'm/s'; without it, spectra are over frequency.")
    length: Length | None = key(None, "Length in the Strouhal number; the pupil's width if absent.")
