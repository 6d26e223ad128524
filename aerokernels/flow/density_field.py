"""Density fields: the base class of all flows, and the doors that make fields of data in memory."""

from abc import ABC, abstractmethod
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.derived import ReadOnly
from aerokernels.device_arrays import plain_array
from aerokernels.display.shown import plane_picture
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import DEFAULT_WAVELENGTH
from aerokernels.medium import Body, IndexField, SolidBody
from aerokernels.medium.grid import as_points, local_coordinates
from aerokernels.medium.labelled_grid import check_order

if TYPE_CHECKING:
    from aerokernels.flow.composition import Composition
    from aerokernels.flow.gas import FreeStream


class DensityField(ReadOnly, ABC):
    """Density in the optical frame (z points upstream), surrounded by ambient gas: the base class of all flows.

    `DensityField(mesh, density, ambient_density, ...)` makes a `CellDensity`; `from_samples` makes a field on a uniform
    grid.

    Attributes:
        geometry: "volume", "planar" or "axisymmetric".
        ambient_density: Density around the field [kg/m3].
        body: Solid body in the flow, or None.
        provenance: Where the field comes from, in words.
        mach: Mach number of the free stream; 0 where the gas is at rest or the Mach number is not known.
        box: Lowest and highest corner of the field, (x, y, z), (y, z) or (r, z) [m].
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
        return super().__new__(_samples().CellDensity if cls is DensityField else cls)

    @staticmethod
    @checked
    def from_samples(
        density: Numbers,
        *,
        origin: Numbers,
        spacing: Numbers,
        geometry: str,
        ambient_density: float,
        cell_averages: bool = False,
        body: Body | SolidBody | None = None,
        conditions: "FreeStream | None" = None,
        composition: "Composition | None" = None,
        provenance: str = "",
    ) -> "DensityField":
        """Return a density field made from samples on a uniform grid.

        Args:
            density: Densities [kg/m3] at the nodes, axes [x, y, z], [y, z] or [r, z]: an array of any library that has
                DLPack or `__cuda_array_interface__` (one on a GPU is copied to the host once).
            origin: Coordinates of the first node [m], one per axis; r starts at 0.
            spacing: Node spacing [m], one per axis.
            geometry: "volume", "planar" or "axisymmetric" (even in r).
            ambient_density: Density outside the grid [kg/m3].
            cell_averages: `density` holds averages over the cells centred on the nodes (finite-volume data), in an
                axisymmetric field over the (r, z) rectangle, without the weight r.
            body: Solid body in the flow: a `Body`, in a volume a `SolidBody`.
            conditions: The free stream, where it is known.
            composition: The gas, where it is a mixture that is known node by node.
            provenance: Where the densities come from, in words.

        Raises:
            TypeError: A density that is not numbers.
            ValueError: Densities that no gas has (the message says how many, and where the first is), shapes that
                disagree, a spacing that is not positive, an unknown geometry, an axisymmetric grid that does not start
                at r = 0, or a body of another geometry.

        Examples:
            >>> import numpy as np
            >>> box = DensityField.from_samples(np.full((9, 9), 1.2), origin=(0.0, -0.1), spacing=(0.01, 0.01),
            ...                                 geometry="axisymmetric", ambient_density=1.2)
            >>> float(box.index_field(905e-9).contrast_at([[0.0, 0.0, -0.05]])[0])
            0.0
        """
        check_order(density, "density", geometry, "DensityField.from_xarray")
        array = density if isinstance(density, np.ma.MaskedArray) else plain_array(density)
        if not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
            raise TypeError(f"density must be an array of real numbers [kg/m3], got dtype {array.dtype}")
        return _samples().GridDensity(
            array, np.asarray(origin), np.asarray(spacing), str(geometry), ambient_density, cell_averages, body,
            conditions, provenance, composition=composition,
        )  # fmt: skip

    @staticmethod
    def from_xarray(array, **arguments) -> "DensityField":
        """Return a density field from an xarray object.

        Coordinates x, y, z make a volume, two of them a plane, r and z an axisymmetric field; their attribute `units`
        gives their unit. The arguments are those of `flow.read` except spacing, region, walls and those for one file
        format.
        """
        return import_module("aerokernels.flow.reading.read").from_xarray(array, **arguments)

    @staticmethod
    def from_pyvista(dataset, **arguments) -> "DensityField":
        """Return a density field from a pyvista or VTK grid.

        The arguments are those of `flow.read` except time, walls and those for one file format.
        """
        return import_module("aerokernels.flow.reading.read").from_pyvista(dataset, **arguments)

    def _picture(self) -> Any:
        return plane_picture(self.density_at, self.box, self.geometry, "density [kg/m3]")

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
        group: bool = False,
    ) -> IndexField:
        """Return the refractive index of the flow at a vacuum wavelength [m], which the index field stores.

        See `SampledDensity.index_field` for the arguments; some flows take further options.
        """


def _samples():
    """Return the module of fields from samples, which builds on this one."""
    return import_module("aerokernels.flow.sampled_density")


def local_points(points, geometry: str) -> np.ndarray:
    """Return points (x, y, z) [m], shape (n, 3), along the axes of samples; other shapes are a ValueError."""
    return local_coordinates(as_points(np.atleast_2d(np.asarray(points)), 3), geometry)
