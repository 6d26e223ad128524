"""The refractive index field: contrast m = n - n_ambient in a box, ambient index outside.

The contrast is stored, never the index: float32 cannot represent small contrasts as part of an index near 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.derived import Derived
from aerokernels.display.shown import plane_picture, shown
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_choice, check_positive, check_wavelength, field_wavelength
from aerokernels.inputs.kinds import are_numbers
from aerokernels.medium.absorption import Absorption, absorption_of
from aerokernels.medium.averages.kept_averages import conserving_values, cut_and_kept
from aerokernels.medium.averages.vertex_values import vertex_values
from aerokernels.medium.bodies.body import Body
from aerokernels.medium.bodies.solid_body import SolidBody
from aerokernels.medium.grid import (
    AXIS_CORE,
    UniformGrid,
    as_points,
    check_box,
    check_finite,
    check_starts_on_axis,
    contrast_array,
    local_coordinates,
    warn_of_index,
)
from aerokernels.medium.labelled_grid import check_order, grid_arguments
from aerokernels.medium.mesh import GEOMETRIES, QuadMesh
from aerokernels.medium.mesh_samples import MeshSamples
from aerokernels.medium.spline import node_values


@dataclass(frozen=True)
class GroupIndex:
    """The group index n_g = n - lambda dn/dlambda of a field, by which a pulse travels.

    Attributes:
        ambient_index: Group index outside the box.
        ratio: Group contrast n_g - n_g,ambient over the contrast, the same everywhere in a field of one gas.
        uncertainty: Relative uncertainty of n_g - 1 at a density, from the refractivity model.
        field: Makes the field of the group index itself, where the gas varies and there is no such ratio; else None.
    """

    ambient_index: float
    ratio: float
    uncertainty: float = 0.0
    field: "Callable[[], IndexField] | None" = None


@dataclass(frozen=True)
class Upstream:
    """What a field keeps of the flow that it was made from, and that no trace through the field can find.

    Attributes:
        columns: Root mean square OPD error of lines through the field, from resampling the flow's own cells [m].
        refractivity: Relative uncertainty of n - 1 at a density, from the refractivity model.
        model: The model's name, and where its constant comes from.
        group: The group index; None where it is not known, and taken to be the index.
        absorption: The absorption coefficient; None where nothing absorbs. See `IndexField.with_absorption`.
    """

    columns: float = 0.0
    refractivity: float = 0.0
    model: str = ""
    group: GroupIndex | None = None
    absorption: Absorption | None = None


@shown
@dataclass(frozen=True, eq=False)
class IndexField(Derived):
    """A refractive index field. Build one with `from_samples` or `from_mesh`.

    Attributes:
        samples: The contrast, on a uniform grid or on a mesh.
        geometry: "volume" [x, y, z], "planar" [y, z] or "axisymmetric" [r, z].
        ambient_index: Index outside the box.
        body: Solid body in the field, or None.
        resampling: Errors measured when the field was resampled from another field, or None.
        wavelength: Vacuum wavelength for which the contrast was computed [m]; None for contrast of no wavelength.
        upstream: Errors from how the field was made from a flow, which enter error budgets; None for raw contrast.
    """

    samples: UniformGrid | MeshSamples
    geometry: str
    ambient_index: float
    body: Body | SolidBody | None = None
    resampling: Any = None
    wavelength: float | None = None
    upstream: Upstream | None = None

    def __post_init__(self):
        """Check the attributes that grids and meshes have in common."""
        check_positive(self.ambient_index, "ambient_index")
        wavelength = None if self.wavelength is None else check_wavelength(self.wavelength)
        self.set_fields(ambient_index=float(self.ambient_index), wavelength=wavelength)
        least = self.samples.extremes[0] if isinstance(self.samples, UniformGrid) else self.samples.values.min()
        if least + self.ambient_index <= 0.0:
            raise ValueError(
                f"the index must be positive everywhere: the least contrast is {least:g}, "
                f"the ambient index {self.ambient_index:g}"
            )
        check_box(self.samples.low, self.samples.high)
        if self.geometry == "axisymmetric":
            check_starts_on_axis(self.samples.low, self.spacing)
        if self.body is not None and self.body.geometry != self.geometry:
            raise ValueError(f"the body is {self.body.geometry}, the field {self.geometry}: they must agree")

    @classmethod
    @checked
    def from_samples(
        cls,
        contrast: Numbers,
        *,
        origin: Numbers,
        spacing: Numbers,
        geometry: str,
        ambient_index: float = 1.0,
        interpolation: str = "cubic",
        body: Body | SolidBody | None = None,
        cell_averages: bool = False,
        wavelength: float | None = None,
        upstream: "Upstream | None" = None,
    ) -> "IndexField":
        """Return a field made from samples on a uniform grid.

        Args:
            contrast: n - ambient_index at the nodes, float64 or float32, axes [x, y, z], [y, z] or [r, z]; float32 is
                kept, in half of the memory. An array of any library that has DLPack or `__cuda_array_interface__`.
            origin: Coordinates of the first node [m], one per axis; r starts at 0.
            spacing: Node spacing [m], one per axis.
            geometry: "volume", "planar" or "axisymmetric" (even in r).
            ambient_index: Index outside the box. The faces of the box do not refract.
            interpolation: "cubic" (C2 B-spline), "linear" or "monotone" (no overshoot at a shock).
            body: Solid body in the field: a `Body`, in a volume a `SolidBody`.
            cell_averages: `contrast` holds averages over the cells centred on the nodes, not samples at the nodes: the
                position of a shock inside a cell is then kept. In an axisymmetric field they are averages over the (r,
                z) rectangle, without the weight r; `from_mesh` takes averages over volumes of revolution.
            wavelength: Vacuum wavelength for which `contrast` was computed [m]; None if it is of no wavelength.
            upstream: Errors of `contrast` from how it was made.

        Raises:
            ValueError: Numbers that are not finite, shapes that disagree, a spacing that is not positive, an unknown
                geometry or interpolation, an axisymmetric grid that does not start at r = 0.
        """
        array = contrast_array(contrast)
        check_choice(geometry, "geometry", GEOMETRIES)
        check_order(contrast, "contrast", geometry, "IndexField.from_xarray")
        geometry, interpolation = str(geometry), str(interpolation)  # NumPy strings would be other keys of kernels
        if array.ndim != (dimension := 3 if geometry == "volume" else 2):
            raise ValueError(f"a {geometry} field needs an array of {dimension} axes, got shape {array.shape}")
        axisymmetric = geometry == "axisymmetric"
        check_positive(ambient_index, "ambient_index")
        grid = UniformGrid(
            array, np.asarray(origin), np.asarray(spacing), interpolation, axisymmetric, float(ambient_index)
        )
        warn_of_index(*grid.extremes)
        if cell_averages:
            at_nodes = node_values(grid.samples.astype(np.float64), interpolation, axisymmetric)
            grid = replace(grid, samples=at_nodes, keeps_averages=True)
        return cls(grid, geometry, ambient_index, body, wavelength=wavelength, upstream=upstream)

    @classmethod
    def from_xarray(cls, array, *, body=None) -> "IndexField":
        """Return a field made from an xarray array of the contrast.

        Its dimensions are x, y, z, or y, z, or r, z, each with coordinates in the unit of their attribute `units`, or
        in metres. The array's own `units` may be that of a ratio ("1e-6", "ppm"). Its attributes `ambient_index`,
        `interpolation`, `wavelength` [m] and `cell_averages` are used where there are any.

        Raises:
            TypeError: Not an xarray array.
            ValueError: Other dimensions, coordinates that are absent or not even, units that are not lengths.
        """
        return cls.from_samples(**grid_arguments(array), body=body)

    @classmethod
    @checked
    def from_mesh(
        cls,
        mesh: QuadMesh,
        contrast: Numbers,
        *,
        ambient_index: float = 1.0,
        interpolation: str = "bilinear",
        body: Body | None = None,
        wavelength: float | None = None,
        upstream: "Upstream | None" = None,
        walls: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> "IndexField":
        """Return a field on a quadrilateral mesh.

        Args:
            mesh: The mesh; its geometry is the field's.
            contrast: n - ambient_index at the vertices, shape (vertex_count,), or finite-volume averages over the
                cells, shape (cell_count,); the shape decides. On a structured mesh also (ni, nj), (ni - 1, nj - 1).
            ambient_index: Index outside the mesh, in holes of it and in one about the axis too.
            interpolation: "bilinear", "bilinear-barron" or "idw" (see mesh_samples.py); or "conserving":
                bilinear on cells cut in four, with values that keep the averages (see kept_averages.py).
            body: Solid body in the field.
            wavelength: Vacuum wavelength for which `contrast` was computed [m]; None if it is of no wavelength.
            upstream: Errors of `contrast` from how it was made.
            walls: Positions at walls [m], shape (n, 2), and the contrast there, used by "conserving" only.

        Raises:
            TypeError: `mesh` is not a QuadMesh.
            ValueError: A shape that fits neither vertices nor cells, or entries that are not finite, also of `walls`.
        """
        if not isinstance(mesh, QuadMesh):
            raise TypeError(f"mesh must be a QuadMesh, got {type(mesh).__name__}: see QuadMesh.structured")
        values = np.array(contrast_array(contrast), dtype=np.float64)
        check_finite(values, "the contrast")
        warn_of_index(values.min(initial=np.inf), values.max(initial=-np.inf))
        if walls is not None:
            if not isinstance(walls, (tuple, list)) or len(walls) != 2 or not all(map(are_numbers, walls)):
                raise TypeError(f"walls must be a pair of arrays, points [m] and contrasts, got {type(walls).__name__}")
            points, own = (np.asarray(each, dtype=np.float64) for each in walls)
            if own.ndim != 1 or points.shape != (len(own), 2):
                raise ValueError(f"walls need points of shape (n, 2) and n contrasts, got {points.shape}, {own.shape}")
            walls = points, own
            check_finite(np.column_stack(walls), "the walls")
        at_vertices, in_cells = mesh.array_shapes
        averages = None
        if interpolation == "conserving" and values.shape not in in_cells:
            raise ValueError("interpolation 'conserving' needs averages over cells: these are values at vertices")
        if values.shape in in_cells:
            averages = values.ravel()
            averages.setflags(write=False)
            vacuum = 1.0 - ambient_index if ambient_index > 1.0 else -np.inf
            if interpolation == "conserving":
                mesh, values, averages = cut_and_kept(mesh, averages, vacuum, walls)
                interpolation = "bilinear"
            elif interpolation == "bilinear":
                values = conserving_values(mesh, averages, vacuum)
            else:
                values = vertex_values(mesh, averages)
        elif values.shape not in at_vertices:
            raise ValueError(
                f"contrast has shape {values.shape}: give one entry for each vertex, shape "
                f"{' or '.join(map(str, at_vertices))}, or one for each cell, shape {' or '.join(map(str, in_cells))}"
            )
        values.setflags(write=False)
        samples = MeshSamples(mesh, values.reshape(-1), interpolation, averages)
        return cls(samples, mesh.geometry, ambient_index, body, wavelength=wavelength, upstream=upstream)

    @cached_property
    def is_uniform(self) -> bool:
        """Whether the samples are on a uniform grid."""
        return isinstance(self.samples, UniformGrid)

    @property
    def source(self) -> "IndexField | None":
        """The original field of a chain of resamplings, this field if there was none, or None if it was not stored."""
        if self.resampling is None:
            return self
        before = getattr(self.resampling, "source", None)
        return None if before is None else before.source

    @cached_property
    def interpolation(self) -> str:
        """Name of the interpolant."""
        return self.samples.interpolation

    @property
    def mesh(self) -> QuadMesh:
        """The mesh of a field on a mesh."""
        if self.is_uniform:
            raise ValueError("this field lies on a uniform grid, it has no mesh")
        return self.samples.mesh

    @cached_property
    def spacing(self) -> np.ndarray:
        """Node spacing [m] of a uniform grid; the median cell size of a mesh, one entry per axis."""
        if self.is_uniform:
            return self.samples.spacing
        return np.full(2, np.median(self.samples.mesh.cell_size))

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner in (x, y, z) [m]; a planar field is infinite in x."""
        low, high = self.samples.low, self.samples.high
        if self.geometry == "volume":
            return low.copy(), high.copy()
        if self.geometry == "planar":
            return np.array([-np.inf, *low]), np.array([np.inf, *high])
        return np.array([-high[0], -high[0], low[1]]), np.array([high[0], high[0], high[1]])

    def local_coordinates(self, points) -> np.ndarray:
        """Return the coordinates along the samples' axes [m] of points (n, 3)."""
        return local_coordinates(np.atleast_2d(np.asarray(points, dtype=np.float64)), self.geometry)

    @checked
    def evaluate(self, points: Numbers) -> tuple[np.ndarray, np.ndarray]:
        """Return contrast, shape (n,), and its gradient [1/m], shape (n, 3), at points (n, 3).

        Both are zero outside the box, and NaN at points that are NaN.
        """
        points = as_points(np.atleast_2d(np.asarray(points)), 3)
        local = self.local_coordinates(points)
        tolerance = 1e-12 * (self.samples.high - self.samples.low)
        inside = np.all((local >= self.samples.low - tolerance) & (local <= self.samples.high + tolerance), axis=1)
        contrast, gradient = np.zeros(len(points)), np.zeros((len(points), 3))
        contrast[inside], slope = self.samples.evaluate(local[inside])
        if self.geometry == "volume":
            gradient[inside] = slope
        elif self.geometry == "planar":
            gradient[inside, 1:] = slope
        else:
            radius = local[inside, 0]
            core = AXIS_CORE * self.samples.spacing[0] if self.interpolation == "linear" else 0.0
            size = np.maximum(radius, core)
            outward = points[inside, :2] / np.where(size > 0.0, size, 1.0)[:, None]
            gradient[inside, :2] = outward * slope[:, :1]
            gradient[inside, 2] = slope[:, 1]
        unknown = np.isnan(local).any(axis=1)
        contrast[unknown], gradient[unknown] = np.nan, np.nan
        return contrast, gradient

    def _picture(self) -> Any:
        return plane_picture(lambda at: 1e6 * self.contrast_at(at), self.box, self.geometry, "index - ambient [1e-6]")

    @checked
    def contrast_at(self, points: Numbers) -> np.ndarray:
        """Return the contrast at points (n, 3), shape (n,)."""
        return self.evaluate(points)[0]

    @checked
    def gradient_at(self, points: Numbers) -> np.ndarray:
        """Return the gradient of the contrast [1/m] at points (n, 3), shape (n, 3)."""
        return self.evaluate(points)[1]

    @checked
    def resample(
        self,
        spacing: Numbers | None = None,
        *,
        tolerance: float | None = None,
        wavelength: float | None = None,
        region: Any = None,
        interpolation: str = "cubic",
    ) -> "IndexField":
        """Return the same field on a uniform grid, with the measured resampling error.

        Args:
            spacing: Greatest node spacing [m], one number or one per axis (the region is divided evenly); or None, with
            tolerance: greatest allowed change of the optical path along lines parallel to z, in waves. The spacing is
                halved until the measured change is within it.
            wavelength: Wavelength for `tolerance` [m]; None takes the field's own, or 905 nm where it has none.
            region: Lowest and highest corner along the field's axes [m]; the whole box if None. Where the field is not
                ambient at a face of its box, the jump there is smoothed over a cell of the grid.
            interpolation: Interpolant of the result.
        """
        from aerokernels.medium.resample import resample

        return resample(
            self, spacing, tolerance=tolerance, wavelength=wavelength, region=region, interpolation=interpolation
        )

    def wavelength_for(self, asked: float | None) -> float:
        """Return the wavelength [m] at which a call evaluates this field: its own, or `asked` for a raw contrast.

        Raises:
            TypeError: `asked` is not one number.
            ValueError: `asked` is not a wavelength in metres, or differs from the field's.
        """
        return field_wavelength(self.wavelength, asked)

    @checked
    def with_absorption(self, coefficient: Any, *, ambient: float = 0.0) -> "IndexField":
        """Return the same field in a gas that absorbs: `TraceResult.transmission`, and with it echoes, follow.

        Args:
            coefficient: The absorption coefficient [1/m] of power in the field's box: a number, an array with one entry
                for each sample of the field (on a mesh also for each cell), or a function of points (n, 3) [m] that
                returns an array of shape (n,).
            ambient: That outside of the box [1/m].

        Raises:
            ValueError: An array of another shape, or numbers that are negative or not finite.

        Example:
            >>> field = IndexField.from_samples(np.zeros((8, 8)), origin=(0, 0), spacing=(1, 1), geometry="planar")
            >>> field.with_absorption(0.1).upstream.absorption.ambient
            0.0
        """
        made = self.upstream or Upstream()
        return replace(self, upstream=replace(made, absorption=absorption_of(self, coefficient, ambient)))

    @checked
    def with_interpolation(self, interpolation: str) -> "IndexField":
        """Return a field of the same samples with another interpolant."""
        return replace(self, samples=replace(self.samples, interpolation=interpolation))
