"""The tables of a scene file: every key with its unit, its default and the reason for it.

Defaults are written as a user would write them and pass the same checks. The source paper states the wavelength, the
pulse's peak power, the target's size, reflectivity and distance, and the wind tunnel's conditions. The other defaults
are choices made here; each key's description explains its own. The flow's file is in file_table.py; beam, target,
receiver and detector are in echo_tables.py.
"""

import math
import os
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from aerokernels.flow import maximum_cone_angle, refractivity_model, shipped_names
from aerokernels.flow.gas import check_density
from aerokernels.flow.refractivity import RELATIONS, default_relation, index_contrast
from aerokernels.inputs.checks import check_wavelength
from aerokernels.inputs.units import quantity
from aerokernels.scene.file_table import FileTable
from aerokernels.scene.values import (
    Angle,
    Count,
    Density,
    Elevation,
    GladstoneDale,
    Length,
    Number,
    Speed,
    Table,
    Time,
    key,
    measured,
)


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


STATIC, CONE = "static", "cone"
AXIAL = ("mach2", "mach3", "mach4")  # the shipped flows that differ in their Mach number alone
UNIFORM_INTERPOLATIONS = ("cubic", "linear", "monotone")
MESH_INTERPOLATIONS = ("bilinear", "bilinear-barron", "idw")


def _source(value: Any) -> str | None:
    choices = (*shipped_names(), STATIC, CONE)
    if value is None or value in choices:
        return value
    if not isinstance(value, str) or not os.path.exists(os.path.expanduser(value)):
        raise ValueError(f"no such file; choose one of {', '.join(choices)}, or the path of a flow file or case")
    return value


def _density(value: Any) -> float | str:
    if value in ("tunnel", "sea-level"):
        return value
    try:
        number = quantity(value, "density")
    except (TypeError, ValueError):
        raise ValueError("give 'tunnel', 'sea-level' or a density such as '0.5 kg/m3'") from None
    if number < 1e-12:
        raise ValueError("a density must be at least 1e-12 kg/m3")
    return check_density(number, "a density")


_density.dimension = "density"  # type: ignore[attr-defined]  # read by `values.dimension_of`


def _wavelength(value: float) -> float:
    check_wavelength(value)
    return value


def _constant(value: float) -> float:
    index_contrast(1.0, 0.0, value)
    return value


class FlowTable(Table):
    """[flow]: the air and its refractive index."""

    source: Annotated[str | None, BeforeValidator(_source)] = key(
        ...,
        '"mach2", "mach3", "mach4": the shipped CFD field of the wind-tunnel model; "static": air at rest; or the path '
        'of your own CFD file or case, relative to the scene file; or "cone": the exact flow over a cone of 0.1 m '
        "length, at mach and half_angle. A scene with a [series] may leave it out; "
        "`aerokernels series` alone accepts it then.",
    )
    file: FileTable = FileTable()
    species: bool | tuple[str, ...] | dict[str, str] | None = key(
        None,
        "Mass fractions in the flow's file, for a gas mixture: true for all arrays named by formulas "
        '(N2, Y_O2, ...), ["N2", "O2"] for these only, {N2 = "Y_N2", O2 = "Y_O2"} for other names, with basis = "mole" '
        'for mole fractions. The relation is then "gladstone-dale" or "lorentz-lorenz".',
    )
    density: Annotated[float | str, BeforeValidator(_density)] = key(
        "tunnel",
        'Free-stream density: "tunnel" is the field\'s own (at rest: sea level), "sea-level" is 1.225 kg/m3, '
        "or a density. The whole field is scaled with it. The paper's tunnel runs at 0.17 to 0.43 of the sea-"
        "level density that its simulation appears to use, so both are shipped as scenes.",
    )
    mach: Annotated[float, measured("dimensionless"), Field(gt=1.0, le=50.0)] | None = key(
        None,
        "Mach number of the free stream: it selects the shipped flow of this Mach number, 2, 3 or 4, in place of the "
        'one that source names, or gives that of source = "cone".',
    )
    half_angle: Annotated[float, measured("angle"), Field(gt=1e-6, lt=1.5)] | None = key(
        None, 'Half angle of source = "cone".'
    )
    altitude: Annotated[float, measured("length"), Field(ge=0.0, le=86e3)] | None = key(
        None,
        "Altitude, in place of density: the free stream has the density of the US Standard Atmosphere 1976. The "
        "whole field is scaled with it, at the flow's own Mach number and temperature.",
    )
    wavelength: Annotated[Length, AfterValidator(_wavelength)] = key(
        "905 nm", "Vacuum wavelength of the laser. The paper's."
    )
    relation: Literal["auto", "paper", "ciddor", "mathar", "gladstone-dale", "lorentz-lorenz"] = key(
        "auto",
        'Relation of density to index: "auto", for standard dry air, is "ciddor" from 0.3 to 1.69 um and "mathar" in '
        'the infrared windows to 24 um; "paper", linear with the paper\'s constant, which is 0.46 % higher at 905 nm; '
        '"gladstone-dale", linear, or "lorentz-lorenz", the exact '
        "form, both with the constant gladstone_dale or else the paper's; the two forms differ by 1.3e-8 at sea level. "
        'If gladstone_dale is given, the default is "gladstone-dale", which "paper" with that constant is too.',
    )
    gladstone_dale: Annotated[GladstoneDale, AfterValidator(_constant)] | None = key(
        None, "Gladstone-Dale constant in place of the paper's K(wavelength), such as '2.24e-4 m3/kg'."
    )
    interpolation: Literal["bilinear", "conserving"] | None = key(
        None,
        'Interpolation between cell averages on a mesh: "bilinear" interpolates values at the cells\' corners; '
        '"conserving" does so on cells divided into four, such that cells keep their averages; beside a captured '
        "shock rows and columns of cells keep theirs to 1e-3 of the range; preparing takes longer. The default is "
        '"conserving" if a solver\'s file has values at walls, else "bilinear". Values at points are interpolated '
        'directly. If grid.route is "mesh", the key applies to grid.interpolation "bilinear".',
    )

    @property
    def is_mixture(self) -> bool:
        """Whether the gas is a mixture of the species in the flow's file."""
        return self.species not in (None, False)

    @model_validator(mode="before")
    @classmethod
    def _a_constant_or_a_mixture_is_gladstone_and_dales(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        relation, given = data.get("relation"), data.get("gladstone_dale") is not None
        chosen = default_relation(given, data.get("species") not in (None, False))
        is_open = relation in (None, "auto") or (given and relation == "paper")
        return {**data, "relation": chosen} if is_open and chosen != cls.model_fields["relation"].default else data

    @model_validator(mode="before")
    @classmethod
    def _mach_selects_the_source(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("mach") is None or data.get("source") == CONE:
            return data
        shipped_at, mach = {name.removeprefix("mach"): name for name in AXIAL}, data["mach"]
        chosen = shipped_at.get(f"{mach:g}" if isinstance(mach, (int, float)) else str(mach).strip())
        if data.get("source") not in AXIAL:
            raise ValueError(
                f"flow.mach = {mach!r} selects one of the flows {', '.join(AXIAL)} or goes with flow.source = 'cone', "
                f"and flow.source = {data.get('source')!r} has its own Mach number: leave flow.mach out"
            )
        if chosen is None:
            raise ValueError(
                f"flow.mach = {mach!r}: choose {', '.join(shipped_at)}, the shipped flows, or flow.source = 'cone' "
                "with flow.half_angle, an exact flow at any Mach number above 1"
            )
        return {**data, "source": chosen}

    @model_validator(mode="after")
    def _cone_and_altitude_fit_the_rest(self) -> "FlowTable":
        if self.altitude is not None and not isinstance(self.density, str):
            raise ValueError("flow.altitude and flow.density both give the free stream's density: drop one")
        if self.source == CONE:
            if self.mach is None or self.half_angle is None:
                raise ValueError(
                    "flow.source = 'cone' needs flow.mach, such as 3, and flow.half_angle, such as '15 deg'"
                )
            if self.half_angle > (most := maximum_cone_angle(self.mach)):
                raise ValueError(
                    f"flow.half_angle of {math.degrees(self.half_angle):.4g} deg detaches the shock at Mach "
                    f"{self.mach:g}: give at most {math.degrees(most):.4g} deg, or a greater flow.mach"
                )
        return self

    @model_validator(mode="after")
    def _relation_fits_the_rest(self) -> "FlowTable":
        if self.is_mixture and self.relation not in RELATIONS and self.gladstone_dale is None:
            raise ValueError(
                f"flow.relation {self.relation!r} is air's, with flow.species use 'gladstone-dale' or 'lorentz-lorenz'"
            )
        try:
            refractivity_model(self.relation, constant=self.gladstone_dale).constant(self.wavelength)
        except ValueError as fault:
            raise ValueError(f"flow.relation {self.relation!r} does not go with the rest of [flow]: {fault}") from None
        return self


class GridTable(Table):
    """[grid]: how the index is interpolated between the CFD cells for the rays."""

    route: Literal["uniform", "mesh"] = key(
        "uniform",
        '"uniform": resample once to a uniform grid and measure the error of resampling; "mesh": find the CFD cell '
        "of every sample, as the paper does.",
    )
    spacing: Length = key(
        "0.05 mm", "Spacing of the uniform grid: about the CFD cells' size in the shock layer ahead of the dome."
    )
    interpolation: Literal["cubic", "linear", "monotone", "bilinear", "bilinear-barron", "idw"] = key(
        "cubic",
        "On the uniform grid: cubic (default, smooth), linear, monotone (no overshoot at a shock). On the "
        "mesh: bilinear (default there; see flow.interpolation), bilinear-barron, idw (the paper's eq 6 and 7, on the "
        "flow's own cells).",
    )

    @model_validator(mode="before")
    @classmethod
    def _default_of_the_route(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("route") == "mesh" and "interpolation" not in values:
            return {**values, "interpolation": MESH_INTERPOLATIONS[0]}
        return values

    @model_validator(mode="after")
    def _interpolation_fits_route(self) -> "GridTable":
        fitting = UNIFORM_INTERPOLATIONS if self.route == "uniform" else MESH_INTERPOLATIONS
        if self.interpolation not in fitting:
            raise ValueError(
                f"grid.interpolation {self.interpolation!r} does not go with grid.route {self.route!r}: "
                f"choose one of {', '.join(fitting)}"
            )
        return self


class StrehlTable(Table):
    """[strehl]: the Strehl ratio of a plane wave through the pupil of [pupil] or [receiver]."""

    ray_count: Annotated[Count, Field(ge=16)] = key(1_000_000, "Rays over the pupil.")
    remove: tuple[Literal["piston", "tilt", "focus"], ...] = key(
        ("piston",),
        'Terms removed from the wavefront first: ["piston"], ["piston", "tilt"] or ["piston", "tilt", "focus"].',
    )


class TraceTable(Table):
    """[trace]: how the rays are traced."""

    method: Literal["auto", "straight", "adaptive", "paper", "fixed"] = key(
        "auto", '"auto" chooses by the tolerance; "paper" is eq 5\'s step rule; "fixed" needs a step.'
    )
    tolerance: Number = key(
        1e-3, "Requested error of the optical path, in waves: a hundredth of a visible wavefront error."
    )
    step: Length | None = key(None, 'Arc length of a step, for method "fixed".')
    precision: Literal["float32", "float64"] = key(
        "float32", "Precision of the kernels; the deviation form keeps float32 within 1e-4 wave."
    )
    backend: Literal["auto", "warp", "opencl", "reference"] = key("auto", "Backend that runs the kernels.")
    device: str | None = key(None, '"cpu", "cuda:0" or the name of an OpenCL device; the backend chooses if absent.')
    max_steps: Count | None = key(
        None, "Greatest number of steps of a ray, which then fails; the tracer chooses if absent."
    )
    allow_truncation: bool = key(
        False,
        "Whether more than a thousandth of the pupil may see disturbed air that the scene's grid has cut off, and more "
        "than half of it past the flow's box; by default this is an error.",
    )

    @model_validator(mode="after")
    def _fixed_needs_a_step(self) -> "TraceTable":
        if self.method == "fixed" and self.step is None:
            raise ValueError("trace.method 'fixed' needs trace.step: add a length such as step = \"0.2 mm\"")
        return self
