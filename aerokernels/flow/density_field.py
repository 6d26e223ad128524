"""Density fields, what a flow hands to the optics: `DensityField`, common to all, and `CellDensity`, on a mesh."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from ..display.shown import shown
from ..inputs.arguments import Numbers, checked, refuse_masked
from ..inputs.checks import check_positive
from ..inputs.wavelength import DEFAULT_WAVELENGTH, check_wavelength
from ..medium import Body, IndexField, QuadMesh, SolidBody
from ..read_only import ReadOnly
from .gas import FreeStream, check_density, no_gas
from .models import MODELS, one_constant, refractivity_model
from .refractivity import RELATIONS
from .species import Composition
from .wall_density import WallDensity


class DensityField(ReadOnly, ABC):
    """Density in the optical frame (z looks upstream), surrounded by ambient gas: what every flow has.

    `DensityField(mesh, density, ambient_density, ...)` makes a `CellDensity`, as `pathlib.Path` makes a path of the
    system it runs on; `isinstance(flow, DensityField)` holds for whatever `aerokernels.flow` makes.

    Attributes:
        geometry: "planar" or "axisymmetric".
        ambient_density: Density around the field [kg/m3].
        body: Solid body in the flow, or None.
        provenance: Where the field comes from, in words.
        mach: Mach number of the free stream; 0 where the gas is at rest, or it is not known.
        box: Lowest and highest corner of the field, (y, z) or (r, z) [m].
    """

    if TYPE_CHECKING:  # fields of some flows, properties of others

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
        """A density field; the common base itself stands for `CellDensity`."""
        return super().__new__(CellDensity if cls is DensityField else cls)

    @staticmethod
    def from_xarray(array, **arguments) -> "DensityField":
        """A density field from an xarray array or data set: see `aerokernels.flow.reading.in_memory.from_xarray`.

        Coordinates x, y, z make a volume, two of them a plane, r and z an axisymmetric field, in their attribute
        `units`. Arguments of `flow.read`: all but spacing, region, walls and those of single formats.

        Raises:
            TypeError: No xarray object.
            ValueError: Coordinates or densities that make no field.
        """
        return import_module(f"{__package__}.reading.in_memory").from_xarray(array, **arguments)

    @staticmethod
    def from_pyvista(dataset, **arguments) -> "DensityField":
        """A density field from a pyvista or VTK grid: see `aerokernels.flow.reading.in_memory.from_pyvista`.

        Arguments are those of `flow.read` but for time, walls and those of single formats.

        Raises:
            TypeError: No data set of pyvista or VTK.
            ValueError: Cells or densities that make no field.
        """
        return import_module(f"{__package__}.reading.in_memory").from_pyvista(dataset, **arguments)

    @abstractmethod
    def density_at(self, points) -> np.ndarray:
        """Density [kg/m3] at points (x, y, z) [m], shape (n, 3): shape (n,), NaN inside the body."""

    @abstractmethod
    def scaled(self, ambient_density: float) -> "DensityField":
        """The same flow at another ambient density [kg/m3], every density ratio kept."""

    @abstractmethod
    def index_field(
        self,
        wavelength: float = DEFAULT_WAVELENGTH,
        relation: str = "gladstone-dale",
        *,
        constant: float | None = None,
        composition=None,
        gladstone_dale: float | None = None,
    ) -> IndexField:
        """The refractive index of the flow at a vacuum wavelength [m], which the field keeps.

        See `SampledDensity.index_field` for the arguments; each flow has options of its own beside them.
        """


def in_plane(points, geometry: str) -> np.ndarray:
    """Points (x, y, z), shape (n, 3), as (y, z) or (r, z) [m], shape (n, 2).

    Raises:
        ValueError: Points of another shape.
    """
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must have shape (n, 3), got {points.shape}")
    first = np.hypot(points[:, 0], points[:, 1]) if geometry == "axisymmetric" else points[:, 1]
    return np.stack([first, points[:, 2]], axis=1)


class SampledDensity(DensityField):
    """What density fields given by numbers have in common, on a mesh or a grid."""

    ambient_density: float
    body: Body | SolidBody | None
    conditions: FreeStream | None
    composition: Composition | None
    density: np.ndarray

    @property
    def mach(self) -> float:
        """Mach number of the free stream; 0 where the gas is at rest, or it is not known."""
        return 0.0 if self.conditions is None else self.conditions.mach

    @checked
    def scaled(self, ambient_density: float):
        """The same flow at another ambient density [kg/m3], every density ratio kept.

        The Euler equations keep their solution, at the same Mach number and temperature, when density and pressure are
        multiplied by one factor; a viscous flow would not.
        """
        ratio = check_positive(ambient_density, "ambient_density") / self.ambient_density
        return replace(  # type: ignore[type-var]
            self,
            density=self.density * ratio,
            ambient_density=float(ambient_density),
            conditions=None if self.conditions is None else self.conditions.at_density(self.conditions.density * ratio),
            provenance=f"{self.provenance}; densities multiplied by {ratio:.8g}".lstrip("; "),
            **self._also_scaled(ratio),
        )

    @checked
    def index_field(
        self,
        wavelength: float = DEFAULT_WAVELENGTH,
        relation: str = "gladstone-dale",
        *,
        constant: float | None = None,
        composition=None,
        gladstone_dale: float | None = None,
        interpolation: str | None = None,
    ) -> IndexField:
        """The refractive index on the same mesh or grid: contrast n - n_ambient, where the densities are.

        The average of n over a cell is taken to be n of the average density. That is exact for Gladstone-Dale; for
        Lorentz-Lorenz it is off by the spread of (K rho)^2 / 6 within a cell, below 1e-8 for air.

        Args:
            wavelength: Vacuum wavelength [m], for K; the field keeps it.
            relation: "paper", "ciddor", "gladstone-dale" or "lorentz-lorenz": see `refractivity_model`. The last two
                take the paper's K(wavelength) unless `constant` or a composition is given, or the field has one.
            constant: K [m3/kg].
            composition: A `Composition` or fractions of species (one for each density may be given, in their order)
                with which K is made. None takes the field's.
            gladstone_dale: Another name for `constant`.
            interpolation: As in IndexField.from_mesh ("bilinear" if None, "conserving" where walls have values of their
                own) or IndexField.from_samples ("cubic"). "bilinear" lacks some of what rows of cells across
                a shock hold, about a per cent of the range at worst; the field's `averages_lacking` tells how much.

        Raises:
            TypeError: The wavelength is not one number.
            ValueError: A wavelength outside the range of K, an unknown relation or interpolation, one of air where the
                field is a mixture, and what `refractivity_model` refuses.
        """
        wavelength = check_wavelength(wavelength)
        given = one_constant(constant, gladstone_dale)
        if given is None and composition is None and self.composition is not None:
            if relation in MODELS and relation not in RELATIONS:
                gas, remedy = ", ".join(self.composition.fractions), "take 'gladstone-dale' or 'lorentz-lorenz'"
                raise ValueError(f"relation {relation!r} is air's, and the flow is a mixture of {gas}: {remedy}")
            composition = self.composition
        model = refractivity_model(relation, constant=given, composition=composition)
        contrast = np.asarray(model.contrast(self.density, self.ambient_density, wavelength))
        contrast.setflags(write=False)  # nobody else has it: no field need copy it
        return self._index(
            contrast,
            interpolation,
            ambient_index=model.ambient_index(self.ambient_density, wavelength),
            body=self.body,
            wavelength=wavelength,
            upstream=model.upstream(wavelength, self._column_error),
            **({} if composition else self._walls(lambda rho: model.contrast(rho, self.ambient_density, wavelength))),
        )

    def _also_scaled(self, ratio: float) -> dict[str, Any]:
        """Other attributes that go with the density, multiplied by a ratio."""
        return {}

    def _walls(self, contrast_of: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
        """What is known at walls, as arguments for `_index`."""
        return {}

    _column_error = 0.0  # [kg/m2] of the density along z, from how it was made

    @abstractmethod
    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        """The index field of contrasts at the densities."""


@dataclass(frozen=True, eq=False)
class MeshDensity(SampledDensity):
    """What density fields on a quadrilateral mesh have in common, averages over cells or values at vertices."""

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
    """Density on a quadrilateral mesh, in the optical frame (z looks upstream), surrounded by ambient gas.

    Attributes:
        mesh: Mesh with columns (r, z) or (y, z) [m].
        density: Cell averages [kg/m3], shape (cell_count,) in the mesh's order; (ni - 1, nj - 1) is accepted.
        ambient_density: Density outside the mesh [kg/m3].
        body: Solid body in the flow, or None.
        conditions: The free stream, or None where the gas is at rest.
        provenance: Where the field comes from, in words.
        composition: The gas, where it is a mixture that is known cell by cell; None for one gas.
        wall: What the solver holds at walls, or None.

    Raises:
        TypeError: The mesh is no QuadMesh.
        ValueError: Densities that are not positive and finite, or no gas's (how many, and where the first is), or
            another number of them than of cells.
    """

    wall: WallDensity | None = field(default=None, kw_only=True)

    def __post_init__(self):
        """Check the densities."""
        self._check_mesh()
        density = np.array(self.density, dtype=np.float64)
        _, shapes = self.mesh.array_shapes
        if density.shape not in shapes:
            raise ValueError(
                f"density has shape {density.shape}, the mesh {len(self.mesh.cells)} cells: "
                f"give one average for each cell, shape {' or '.join(map(str, shapes))}"
            )
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
        """Density [kg/m3] of the cells that hold points (x, y, z) [m], shape (n, 3): shape (n,).

        NaN inside the body; the ambient density outside the mesh.

        Raises:
            ValueError: Points of another shape.
        """
        local = in_plane(points, self.geometry)
        cell = self.mesh.locate(local)
        density = np.where(cell >= 0, self.density[cell], self.ambient_density)
        return density if self.body is None else np.where(self.body.contains(local), np.nan, density)

    @checked
    def columns(self, position: Numbers, direction: Numbers) -> np.ndarray:
        """Integrals of density less the ambient one along whole lines [kg/m2], exactly as the cells hold it.

        See `aerokernels.medium.mesh_columns`. What rays see is an interpolant through the averages, or, with the
        interpolation "cells", the averages themselves.

        Args:
            position: A point on each line [m], shape (line_count, 3) or (3,).
            direction: Unit vectors, shape (line_count, 3) or (3,).

        Raises:
            ValueError: Directions that are no unit vectors, lines along x of a planar field.
        """
        from ..medium.mesh_columns import mesh_columns

        return mesh_columns(self.mesh, self.density - self.ambient_density, position, direction)

    def _also_scaled(self, ratio: float) -> dict[str, Any]:
        return {} if self.wall is None else {"wall": self.wall.scaled(ratio)}

    def _walls(self, contrast_of: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
        return {} if self.wall is None else {"walls": (self.wall.points, contrast_of(self.wall.density))}

    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        usual = "conserving" if "walls" in common else "bilinear"
        return IndexField.from_mesh(self.mesh, contrast, interpolation=interpolation or usual, **common)
