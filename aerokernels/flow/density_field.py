"""Density fields: the base classes of all flows, and `CellDensity`, finite-volume averages on a mesh."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from aerokernels.inputs.kinds import refuse_masked

from ..display.shown import shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive
from ..inputs.wavelength import DEFAULT_WAVELENGTH, check_wavelength
from ..medium import Body, IndexField, QuadMesh, SolidBody
from ..medium.grid import local_coordinates
from ..read_only import ReadOnly
from .gas import FreeStream, check_density, no_gas
from .models import MODELS, one_constant, refractivity_model
from .refractivity import RELATIONS
from .species import Composition
from .wall_density import WallDensity


class DensityField(ReadOnly, ABC):
    """Density in the optical frame (z points upstream), surrounded by ambient gas: the base class of all flows.

    `DensityField(mesh, density, ambient_density, ...)` makes a `CellDensity`, as `pathlib.Path` makes a path of the
    system it runs on. Every flow that `aerokernels.flow` makes is an instance of `DensityField`.

    Attributes:
        geometry: "planar" or "axisymmetric".
        ambient_density: Density around the field [kg/m3].
        body: Solid body in the flow, or None.
        provenance: Where the field comes from, in words.
        mach: Mach number of the free stream; 0 where the gas is at rest or the Mach number is not known.
        box: Lowest and highest corner of the field, (y, z) or (r, z) [m].
    """

    if TYPE_CHECKING:  # data class fields of some flows, properties of others

        @property
        def geometry(self) -> str: ...  # noqa: D102
        @property
        def ambient_density(self) -> float: ...  # noqa: D102
        @property
        def body(self) -> Body | SolidBody | None: ...  # noqa: D102
        @property
        def provenance(self) -> str: ...  # noqa: D102
        @property
        def mach(self) -> float: ...  # noqa: D102
        @property
        def box(self) -> tuple[np.ndarray, np.ndarray]: ...  # noqa: D102

    def __new__(cls, *args, **kwargs):
        """Make a density field; `DensityField` itself makes a `CellDensity`."""
        return super().__new__(CellDensity if cls is DensityField else cls)

    @staticmethod
    def from_xarray(array, **arguments) -> "DensityField":
        """Return a density field from an xarray object: see `aerokernels.flow.reading.in_memory.from_xarray`.

        Coordinates x, y, z make a volume, two of them a plane, r and z an axisymmetric field; their attribute `units`
        gives their unit. The arguments are those of `flow.read` except spacing, region, walls and those for one file
        format.

        Raises:
            TypeError: Not an xarray object.
            ValueError: Coordinates or densities that do not make a field.
        """
        return import_module(f"{__package__}.reading.in_memory").from_xarray(array, **arguments)

    @staticmethod
    def from_pyvista(dataset, **arguments) -> "DensityField":
        """Return a density field from a pyvista or VTK grid: see `aerokernels.flow.reading.in_memory.from_pyvista`.

        The arguments are those of `flow.read` except time, walls and those for one file format.

        Raises:
            TypeError: Not a pyvista or VTK data set.
            ValueError: Cells or densities that do not make a field.
        """
        return import_module(f"{__package__}.reading.in_memory").from_pyvista(dataset, **arguments)

    @abstractmethod
    def density_at(self, points) -> np.ndarray:
        """Return the density [kg/m3], shape (n,), at points (x, y, z) [m], shape (n, 3); NaN inside the body."""

    @abstractmethod
    def scaled(self, ambient_density: float) -> "DensityField":
        """Return the same flow at another ambient density [kg/m3], with every density ratio unchanged."""

    @abstractmethod
    def index_field(
        self,
        wavelength: float = DEFAULT_WAVELENGTH,
        relation: str | None = None,
        *,
        constant: float | None = None,
        composition=None,
        gladstone_dale: float | None = None,
        group: bool = False,
    ) -> IndexField:
        """Return the refractive index of the flow at a vacuum wavelength [m], which the index field stores.

        See `SampledDensity.index_field` for the arguments; some flows take further options.
        """


def local_points(points, geometry: str) -> np.ndarray:
    """Return points (x, y, z) [m], shape (n, 3), along the axes of samples: see `medium.grid.local_coordinates`.

    Raises:
        ValueError: Points of another shape.
    """
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must have shape (n, 3), got {points.shape}")
    return local_coordinates(points, geometry)


class SampledDensity(DensityField):
    """Base class of density fields given by samples on a mesh or a grid."""

    ambient_density: float
    body: Body | SolidBody | None
    conditions: FreeStream | None
    composition: Composition | None
    density: np.ndarray
    wall: WallDensity | None = None
    _column_error = 0.0  # error of the integral of density along z [kg/m2] from resampling

    @property
    def mach(self) -> float:
        """Mach number of the free stream; 0 where the gas is at rest or the Mach number is not known."""
        return 0.0 if self.conditions is None else self.conditions.mach

    @checked
    def scaled(self, ambient_density: float):
        """Return the same flow at another ambient density [kg/m3], with every density ratio unchanged.

        A solution of the Euler equations remains one, at the same Mach number and temperature, when density and
        pressure are multiplied by one factor. A viscous flow would change with its Reynolds number.
        """
        ratio = check_positive(ambient_density, "ambient_density") / self.ambient_density
        return replace(  # type: ignore[type-var]
            self,
            density=self.density * ratio,
            ambient_density=float(ambient_density),
            conditions=None if self.conditions is None else self.conditions.at_density(self.conditions.density * ratio),
            provenance=f"{self.provenance}; densities multiplied by {ratio:.8g}".lstrip("; "),
            **({} if self.wall is None else {"wall": self.wall.scaled(ratio)}),
        )

    @checked
    def index_field(
        self,
        wavelength: float = DEFAULT_WAVELENGTH,
        relation: str | None = None,
        *,
        constant: float | None = None,
        composition=None,
        gladstone_dale: float | None = None,
        interpolation: str | None = None,
        group: bool = False,
    ) -> IndexField:
        """Return the contrast n - n_ambient on the same mesh or grid as the densities.

        The average of n over a cell is taken to be n of the average density. This is exact for Gladstone-Dale. For
        Lorentz-Lorenz the error is the spread of (K rho)^2 / 6 within a cell, below 1e-8 for air.

        Args:
            wavelength: Vacuum wavelength [m], for K; stored with the index field.
            relation: "paper", "ciddor", "gladstone-dale" or "lorentz-lorenz": see `refractivity_model`. The last two
                take the paper's K(wavelength) unless `constant` or a composition is given, or the field has a
                composition. None is "ciddor", or "gladstone-dale" where one of these is given.
            constant: K [m3/kg].
            composition: A `Composition` or fractions of species from which K is computed; fractions may be arrays with
                one entry for each density, in the same order. None takes the field's composition.
            gladstone_dale: Another name for `constant`.
            interpolation: As in IndexField.from_mesh (None: "bilinear", or "conserving" where the walls have values of
                their own) or IndexField.from_samples (None: "cubic"). Along rows of cells across a shock the integral
                of the "bilinear" interpolant differs from the cell averages', at worst by about a per cent of the
                range of densities; the index field's `averages_lacking` reports by how much.
            group: Make the field of the group index, by which a pulse travels; `trace` needs it only where the gas
                varies.

        Raises:
            TypeError: The wavelength is not one number.
            ValueError: A wavelength outside the range of K, an unknown relation or interpolation, a relation for air
                where the field is a mixture, or arguments that `refractivity_model` rejects.
        """
        wavelength = check_wavelength(wavelength)
        given = one_constant(constant, gladstone_dale)
        if given is None and composition is None and self.composition is not None:
            if relation in MODELS and relation not in RELATIONS:
                gas, remedy = ", ".join(self.composition.fractions), "take 'gladstone-dale' or 'lorentz-lorenz'"
                raise ValueError(f"relation {relation!r} is for air, and the flow is a mixture of {gas}: {remedy}")
            composition = self.composition
        model = refractivity_model(relation, constant=given, composition=composition)
        contrast = np.asarray(model.contrast(self.density, self.ambient_density, wavelength, group=group))
        contrast.setflags(write=False)  # an index field does not copy a read-only array
        again = partial(self.index_field, wavelength, relation, composition=composition, interpolation=interpolation)
        walls = {}
        if self.wall is not None and not composition:
            at_walls = model.contrast(self.wall.density, self.ambient_density, wavelength, group=group)
            walls["walls"] = self.wall.points, at_walls
        return self._index(
            contrast,
            interpolation,
            body=self.body,
            **model.field_arguments(self.ambient_density, wavelength, self._column_error, group, again),
            **walls,
        )

    def _where_known(self, density: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Return densities, shape (n,), with NaN at local points (n, d) [m] that are inside the body or are NaN."""
        unknown = np.isnan(local).any(axis=1)
        if self.body is not None:
            unknown |= self.body.contains(local)
        return np.where(unknown, np.nan, density)

    @abstractmethod
    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        """Return the index field of contrasts that lie where the densities do."""


@dataclass(frozen=True, eq=False)
class MeshDensity(SampledDensity):
    """Base class of density fields on a quadrilateral mesh, with averages over cells or values at vertices."""

    mesh: QuadMesh
    density: np.ndarray
    ambient_density: float
    body: Body | None = None
    conditions: FreeStream | None = None
    provenance: str = ""
    composition: Composition | None = field(default=None, kw_only=True)

    def _check_mesh(self) -> None:
        if not isinstance(self.mesh, QuadMesh):
            raise TypeError(f"mesh must be a QuadMesh, got {type(self.mesh).__name__}: see QuadMesh.structured")
        refuse_masked(self.density, "density")
        object.__setattr__(self, "ambient_density", check_density(self.ambient_density, "ambient_density"))

    def _check_shape(self, density: np.ndarray, shapes: list[tuple[int, ...]], wanted: str) -> None:
        if density.shape not in shapes:
            raise ValueError(
                f"density has shape {density.shape}, the mesh {wanted}: give one density for each, shape "
                f"{' or '.join(map(str, shapes))}"
            )

    @property
    def geometry(self) -> str:
        """The mesh's geometry: "planar" or "axisymmetric"."""
        return self.mesh.geometry

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the mesh, (y, z) or (r, z) [m]."""
        return self.mesh.box


@shown
@dataclass(frozen=True, eq=False)
class CellDensity(MeshDensity):
    """Averages of the density over the cells of a quadrilateral mesh, in the optical frame (z points upstream).

    Attributes:
        mesh: Mesh with columns (r, z) or (y, z) [m].
        density: Cell averages [kg/m3], shape (cell_count,) in the mesh's order; (ni - 1, nj - 1) is accepted.
        ambient_density: Density outside the mesh [kg/m3].
        body: Solid body in the flow, or None.
        conditions: The free stream, or None where the gas is at rest.
        provenance: Where the field comes from, in words.
        composition: The gas, where it is a mixture that is known cell by cell; None for one gas.
        wall: The solver's densities at walls, or None.

    Raises:
        TypeError: The mesh is not a QuadMesh.
        ValueError: Densities that are not positive and finite or are too great for a gas (the message says how many,
            and where the first is), or a number of densities other than the number of cells.
    """

    wall: WallDensity | None = field(default=None, kw_only=True)

    def __post_init__(self):
        """Check the densities."""
        self._check_mesh()
        density = np.array(self.density, dtype=np.float64)
        self._check_shape(density, self.mesh.array_shapes[1], f"{len(self.mesh.cells)} cells")
        density = density.ravel()
        if wrong := no_gas(density):
            self._refuse(density, *wrong)
        density.setflags(write=False)
        object.__setattr__(self, "density", density)

    def _refuse(self, density: np.ndarray, fault: str, count: int, first: int) -> NoReturn:
        place = f"cell {first}"
        if self.mesh.shape is not None:
            place += f" (row {first // (self.mesh.shape[1] - 1)}, column {first % (self.mesh.shape[1] - 1)})"
        centre = self.mesh.corners[first].mean(axis=0)
        axes = "r, z" if self.mesh.geometry == "axisymmetric" else "y, z"
        raise ValueError(
            f"{count} of {density.size} densities are {fault}: the first is {float(density[first])!r} kg/m3 "
            f"in {place} at {axes} = {centre[0]:.6g}, {centre[1]:.6g} m; repair the flow file"
        )

    @checked
    def density_at(self, points: Numbers) -> np.ndarray:
        """Return the density [kg/m3], shape (n,), of the cells that contain points (x, y, z) [m], shape (n, 3).

        NaN inside the body and at points that are NaN; the ambient density outside the mesh.

        Raises:
            ValueError: Points of another shape.
        """
        local = local_points(points, self.geometry)
        cell = self.mesh.locate(local)
        return self._where_known(np.where(cell >= 0, self.density[cell], self.ambient_density), local)

    @checked
    def columns(self, position: Numbers, direction: Numbers) -> np.ndarray:
        """Return integrals of (density - ambient density) along whole lines [kg/m2], exact for the cell averages.

        See `aerokernels.medium.mesh_columns`. Rays see an interpolant of the averages or, with the interpolation
        "cells", the averages themselves.

        Args:
            position: A point on each line [m], shape (line_count, 3) or (3,).
            direction: Unit vectors, shape (line_count, 3) or (3,).

        Raises:
            ValueError: Directions that are not unit vectors, or lines along x of a planar field.
        """
        from ..medium.mesh_columns import mesh_columns

        return mesh_columns(self.mesh, self.density - self.ambient_density, position, direction)

    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        usual = "conserving" if "walls" in common else "bilinear"
        return IndexField.from_mesh(self.mesh, contrast, interpolation=interpolation or usual, **common)
