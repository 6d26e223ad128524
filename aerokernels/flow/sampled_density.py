"""Density fields from samples at the vertices of a mesh, or on a uniform grid of two or three axes."""

from dataclasses import dataclass, field

import numpy as np

from aerokernels.inputs.kinds import refuse_half_precision, refuse_masked

from ..display.shown import shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_choice
from ..medium import Body, IndexField, SolidBody
from ..medium.grid import check_starts_on_axis, checked_axes
from ..medium.mesh import GEOMETRIES
from ..medium.mesh_samples import MeshSamples
from .density_field import MeshDensity, SampledDensity, local_points
from .gas import FreeStream, check_density, no_gas
from .species import Composition


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


@shown
@dataclass(frozen=True, eq=False)
class VertexDensity(MeshDensity):
    """Density at the vertices of a quadrilateral mesh, in the optical frame (z points upstream), in ambient gas.

    Attributes:
        mesh: Mesh with columns (r, z) or (y, z) [m].
        density: Densities at the vertices [kg/m3], shape (vertex_count,); (ni, nj) is accepted.
        ambient_density: Density outside the mesh [kg/m3].
        body: Solid body in the flow, or None.
        conditions: The free stream, or None where it is not known.
        provenance: Where the field comes from, in words.
        composition: The gas, where it is a mixture that is known vertex by vertex; None for one gas.

    Raises:
        TypeError: The mesh is not a QuadMesh.
        ValueError: Densities that no gas has, or an array that has not one density for each vertex.
    """

    def __post_init__(self):
        """Check the densities."""
        self._check_mesh()
        density = _checked(self.density, "at vertices")
        self._check_shape(density, self.mesh.array_shapes[0], f"{len(self.mesh.vertices)} vertices")
        object.__setattr__(self, "density", density.reshape(-1))

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
        body: Solid body in the flow: a `Body`, in a volume a `SolidBody`; or None.
        conditions: The free stream, or None where it is not known.
        provenance: Where the field comes from, in words.
        resampling: Errors measured when the grid was made from a mesh, or None.
        composition: The gas, where it is a mixture that is known node by node; None for one gas.

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
        for name, value in (("density", density), ("origin", origin), ("spacing", spacing)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "ambient_density", float(self.ambient_density))

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the grid, (x, y, z), (y, z) or (r, z) [m]."""
        return self.origin.copy(), self.origin + self.spacing * (np.array(self.density.shape) - 1)

    @checked
    def density_at(self, points: Numbers) -> np.ndarray:
        """Return the density [kg/m3], shape (n,), linear between nodes, at points (x, y, z) [m], shape (n, 3).

        NaN inside the body and at points that are NaN; the ambient density outside the grid.
        """
        local = local_points(points, self.geometry)
        low, high = self.box
        slack = 1e-12 * (high - low)
        inside = np.all((local >= low - slack) & (local <= high + slack), axis=1)
        density = np.full(len(local), self.ambient_density)
        density[inside] = linear_between(self.density, self.origin, self.spacing, local[inside])
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


def linear_between(samples: np.ndarray, origin, spacing, points: np.ndarray) -> np.ndarray:
    """Return values at points (n, d), linear between the nodes of a grid; beyond the grid those at its edge."""
    from scipy.ndimage import map_coordinates

    place = ((points - origin) / spacing).T
    return np.asarray(map_coordinates(samples, place, order=1, mode="nearest", prefilter=False))
