"""Density fields from samples: averages over the cells of a mesh, values at its vertices, or on a uniform grid."""

from abc import abstractmethod
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NoReturn, Self

import numpy as np

from aerokernels.display.shown import shown
from aerokernels.flow.composition import Composition
from aerokernels.flow.density_field import DensityField, local_points
from aerokernels.flow.gas import FreeStream, check_density, no_gas
from aerokernels.flow.refractivity import MODELS, RELATIONS, refractivity_model
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import DEFAULT_WAVELENGTH, check_choice, check_positive, check_wavelength
from aerokernels.inputs.kinds import refuse_half_precision, refuse_masked
from aerokernels.medium import Body, IndexField, QuadMesh, SolidBody
from aerokernels.medium.grid import check_starts_on_axis, checked_axes
from aerokernels.medium.mesh import GEOMETRIES
from aerokernels.medium.mesh_samples import MeshSamples


class SampledDensity(DensityField):
    """Base class of density fields given by samples on a mesh or a grid."""

    ambient_density: float
    body: Body | SolidBody | None
    conditions: FreeStream | None
    composition: Composition | None
    density: np.ndarray
    wall: tuple[np.ndarray, np.ndarray] | None = None
    _column_error = 0.0  # error of the integral of density along z [kg/m2] from resampling

    @property
    def mach(self) -> float:
        """Mach number of the free stream; 0 where the gas is at rest or the Mach number is not known."""
        return 0.0 if self.conditions is None else self.conditions.mach

    @checked
    def scaled(self, ambient_density: float) -> Self:
        """Return the same flow at another ambient density [kg/m3], with every density ratio unchanged.

        A solution of the Euler equations remains one, at the same Mach number and temperature.
        """
        ratio = check_positive(ambient_density, "ambient_density") / self.ambient_density
        return replace(  # type: ignore[type-var]
            self,
            density=self.density * ratio,
            ambient_density=float(ambient_density),
            conditions=None if self.conditions is None else self.conditions.at_density(self.conditions.density * ratio),
            provenance=f"{self.provenance}; densities multiplied by {ratio:.8g}".lstrip("; "),
            **({} if self.wall is None else {"wall": (self.wall[0], self.wall[1] * ratio)}),
        )

    @checked
    def index_field(
        self,
        wavelength: float = DEFAULT_WAVELENGTH,
        relation: str | None = None,
        *,
        constant: float | None = None,
        composition=None,
        interpolation: str | None = None,
        group: bool = False,
    ) -> IndexField:
        """Return the contrast n - n_ambient on the same mesh or grid as the densities.

        The average of n over a cell is taken to be n of the average density: exact for Gladstone-Dale, for
        Lorentz-Lorenz within 1e-8 for air.

        Args:
            wavelength: Vacuum wavelength [m], for K; stored with the index field.
            relation: One of `MODELS`; None is "auto", air's, or "gladstone-dale" with a constant or a composition: see
                `refractivity_model`.
            constant: K [m3/kg].
            composition: A `Composition` or fractions of species from which K is computed; fractions may be arrays with
                one entry for each density, in the same order. None takes the field's composition.
            interpolation: As in IndexField.from_mesh (None: "bilinear", or "conserving" where the walls have values of
                their own) or IndexField.from_samples (None: "cubic").
            group: Make the field of the group index, by which a pulse travels; `trace` needs it only where the gas
                varies.

        Raises:
            TypeError: The wavelength is not one number.
            ValueError: A wavelength outside the range of K, an unknown relation or interpolation, a relation for air
                where the field is a mixture, or arguments that `refractivity_model` rejects.
        """
        wavelength = check_wavelength(wavelength)
        if constant is None and composition is None and self.composition is not None:
            if relation in MODELS and relation not in ("auto", *RELATIONS):
                gas, remedy = ", ".join(self.composition.fractions), "take 'gladstone-dale' or 'lorentz-lorenz'"
                raise ValueError(f"relation {relation!r} is for air, and the flow is a mixture of {gas}: {remedy}")
            composition = self.composition
        model = refractivity_model(relation, constant=constant, composition=composition)
        contrast = np.asarray(model.contrast(self.density, self.ambient_density, wavelength, group=group))
        contrast.setflags(write=False)  # an index field does not copy a read-only array
        again = partial(self.index_field, wavelength, relation, composition=composition, interpolation=interpolation)
        walls = {}
        if self.wall is not None and not composition:
            points, density = self.wall
            walls["walls"] = points, model.contrast(density, self.ambient_density, wavelength, group=group)
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
        self.set_fields(ambient_density=check_density(self.ambient_density, "ambient_density"))

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
        wall: Points of walls (y, z) or (r, z) [m], shape (n, 2), and the solver's densities there [kg/m3]; or None.

    Raises:
        TypeError: The mesh is not a QuadMesh.
        ValueError: Densities that no gas has, or a number of them other than the number of cells.
    """

    wall: tuple[np.ndarray, np.ndarray] | None = field(default=None, kw_only=True)

    def __post_init__(self):
        """Check the densities."""
        self._check_mesh()
        density = np.array(self.density, dtype=np.float64)
        self._check_shape(density, self.mesh.array_shapes[1], f"{len(self.mesh.cells)} cells")
        density = density.ravel()
        if wrong := no_gas(density):
            self._refuse(density, *wrong)
        if self.wall is not None and (wrong := no_gas(self.wall[1])):
            total = len(self.wall[1])
            raise ValueError(f"{wrong[1]} of {total} densities at walls are {wrong[0]}: repair the flow file")
        self.set_fields(density=density)

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

        Args:
            position: A point on each line [m], shape (line_count, 3) or (3,).
            direction: Unit vectors, shape (line_count, 3) or (3,).

        Raises:
            ValueError: Directions that are not unit vectors, or lines along x of a planar field.
        """
        from aerokernels.medium.mesh_samples import mesh_columns

        return mesh_columns(self.mesh, self.density - self.ambient_density, position, direction)

    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        usual = "conserving" if "walls" in common else "bilinear"
        return IndexField.from_mesh(self.mesh, contrast, interpolation=interpolation or usual, **common)


@shown
@dataclass(frozen=True, eq=False)
class VertexDensity(MeshDensity):
    """Density at the vertices of a quadrilateral mesh, in the optical frame (z points upstream), in ambient gas.

    Attributes:
        density: Densities at the vertices [kg/m3], shape (vertex_count,); (ni, nj) is accepted. The other attributes
            are those of `CellDensity`.

    Raises:
        TypeError: The mesh is not a QuadMesh.
        ValueError: Densities that no gas has, or an array that has not one density for each vertex.
    """

    def __post_init__(self):
        """Check the densities."""
        self._check_mesh()
        density = _checked(self.density, "at vertices")
        self._check_shape(density, self.mesh.array_shapes[0], f"{len(self.mesh.vertices)} vertices")
        self.set_fields(density=density.reshape(-1))

    @checked
    def density_at(self, points: Numbers) -> np.ndarray:
        """Return the density [kg/m3], shape (n,), bilinear between vertices, at points (x, y, z) [m], shape (n, 3).

        NaN inside the body and at points that are NaN; the ambient density outside the mesh.
        """
        local = local_points(points, self.geometry)
        excess = MeshSamples(self.mesh, self.density - self.ambient_density, "bilinear").evaluate(local)[0]
        return self._where_known(self.ambient_density + excess, local)

    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        # from_mesh tells values at vertices from cell averages by the shape.
        at_vertices = contrast.reshape(self.mesh.shape or contrast.shape)
        return IndexField.from_mesh(self.mesh, at_vertices, interpolation=interpolation or "bilinear", **common)


@shown
@dataclass(frozen=True, eq=False)
class GridDensity(SampledDensity):
    """Density on a uniform grid, in the optical frame (z points upstream), surrounded by ambient gas.

    Attributes:
        density: Densities [kg/m3], axes [x, y, z], [y, z] or [r, z].
        origin: Coordinates of the first node [m], one per axis; r starts at 0.
        spacing: Node spacing [m], one per axis.
        geometry: "volume", "planar" or "axisymmetric".
        ambient_density: Density outside the grid [kg/m3].
        cell_averages: The samples are averages over cells centred on the nodes, not values at the nodes; in an
            axisymmetric field over the (r, z) rectangle, without the weight r.
        resampling: Errors measured when the grid was made from a mesh, or None. The other attributes are those of
            `CellDensity`; the body of a volume is a `SolidBody`.

    Raises:
        ValueError: Densities that no gas has, shapes that disagree, or a grid that `IndexField.from_samples` rejects.
    """

    density: np.ndarray
    origin: np.ndarray
    spacing: np.ndarray
    geometry: str
    ambient_density: float
    cell_averages: bool = False
    body: Body | SolidBody | None = None
    conditions: FreeStream | None = None
    provenance: str = ""
    resampling: object = None
    composition: Composition | None = field(default=None, kw_only=True)

    def __post_init__(self):
        """Check the grid."""
        check_choice(self.geometry, "geometry", GEOMETRIES)
        check_density(self.ambient_density, "ambient_density")
        density = _checked(self.density, "on the grid")
        if density.ndim != (3 if self.geometry == "volume" else 2):
            raise ValueError(f"a {self.geometry} field cannot have densities of shape {density.shape}")
        if self.body is not None and self.body.geometry != self.geometry:
            raise ValueError(f"the body is {self.body.geometry}, the field {self.geometry}: they must agree")
        origin, spacing = checked_axes(density.shape, self.origin, self.spacing)
        if self.geometry == "axisymmetric":
            check_starts_on_axis(origin, spacing)
        ambient_density = float(self.ambient_density)
        self.set_fields(density=density, origin=origin, spacing=spacing, ambient_density=ambient_density)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the grid, (x, y, z), (y, z) or (r, z) [m]."""
        return self.origin.copy(), self.origin + self.spacing * (np.array(self.density.shape) - 1)

    @checked
    def density_at(self, points: Numbers) -> np.ndarray:
        """Return the density [kg/m3], shape (n,), linear between nodes, at points (x, y, z) [m], shape (n, 3).

        NaN inside the body and at points that are NaN; the ambient density outside the grid.
        """
        from scipy.ndimage import map_coordinates

        local = local_points(points, self.geometry)
        low, high = self.box
        slack = 1e-12 * (high - low)
        inside = np.all((local >= low - slack) & (local <= high + slack), axis=1)
        density = np.full(len(local), self.ambient_density)
        place = ((local[inside] - self.origin) / self.spacing).T
        density[inside] = map_coordinates(self.density, place, order=1, mode="nearest", prefilter=False)
        return self._where_known(density, local)

    @property
    def _column_error(self) -> float:  # type: ignore[override]
        return float(getattr(self.resampling, "column_error", 0.0))

    def _index(self, contrast: np.ndarray, interpolation: str | None, **common) -> IndexField:
        return IndexField.from_samples(
            contrast,
            origin=self.origin,
            spacing=self.spacing,
            geometry=self.geometry,
            interpolation=interpolation or "cubic",
            cell_averages=self.cell_averages,
            **common,
        )


def _checked(density, what: str) -> np.ndarray:
    refuse_masked(density, "density")
    refuse_half_precision(density, "density")
    ours = isinstance(density, np.ndarray) and density.dtype == np.float64 and density.flags.c_contiguous
    # Read-only arrays are not copied, since grids may have 100 million nodes.
    values = density if ours and not density.flags.writeable else np.array(density, dtype=np.float64)
    if wrong := no_gas(values):
        fault, count, place = wrong
        first = tuple(int(k) for k in np.unravel_index(place, values.shape))
        raise ValueError(
            f"{count} of {values.size} densities {what} are {fault}: the first is {float(values[first])!r} kg/m3 at "
            f"index {first}; repair the flow file"
        )
    values.setflags(write=False)
    return values
