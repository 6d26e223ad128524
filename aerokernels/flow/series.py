"""Series: snapshots of a flow in time, each read when it is requested.

`series[i]` is a DensityField; `series.density(i)` the bare array, for a hundred thousand snapshots one after another.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from aerokernels.derived import Derived
from aerokernels.device_arrays import host_array
from aerokernels.display.shown import shown
from aerokernels.flow.density_field import DensityField
from aerokernels.flow.gas import FreeStream, check_density
from aerokernels.flow.sampled_density import CellDensity, GridDensity, SampledDensity, VertexDensity
from aerokernels.inputs.arguments import seconds
from aerokernels.inputs.checks import check_choice
from aerokernels.medium import Body, QuadMesh, SolidBody
from aerokernels.medium.grid import checked_axes
from aerokernels.medium.mesh import GEOMETRIES


@dataclass(frozen=True, eq=False)
class GridMesh(Derived):
    """The uniform grid on which the samples of a series are given, in the optical frame.

    Attributes:
        geometry: "volume" [x, y, z], "planar" [y, z] or "axisymmetric" [r, z].
        origin: Coordinates of the first node [m], one per axis.
        spacing: Node spacing [m], one per axis.
        shape: Number of nodes along each axis.
        cell_averages: The samples are averages over cells centred on the nodes, not values at the nodes.

    Raises:
        ValueError: An unknown geometry, entries that do not match its axes, a spacing that is not positive, or fewer
            than two nodes along an axis.
    """

    geometry: str
    origin: np.ndarray
    spacing: np.ndarray
    shape: tuple[int, ...]
    cell_averages: bool = False

    def __post_init__(self) -> None:
        """Check."""
        check_choice(self.geometry, "geometry", GEOMETRIES)
        dimension, shape = 3 if self.geometry == "volume" else 2, tuple(int(count) for count in self.shape)
        if len(shape) != dimension:
            raise ValueError(f"a {self.geometry} series has arrays of {dimension} axes, got shape {shape}")
        origin, spacing = checked_axes(shape, self.origin, self.spacing)
        self.set_fields(origin=origin, spacing=spacing, shape=shape)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner [m]."""
        return self.origin.copy(), self.origin + self.spacing * (np.array(self.shape) - 1)


@shown
@dataclass(frozen=True, eq=False)
class Series:
    """Snapshots in time. Build one with `open_series`.

    Attributes:
        get: Returns the density of a snapshot by its number: an array, or a whole DensityField.
        time: Time of each snapshot [s], shape (n,).
        mesh: The mesh of the first snapshot at least: a GridMesh, a QuadMesh, or None where there is none, as for a
            formula.
        ambient_density: Density around the field of the first snapshot at least [kg/m3], or None.
        body: Solid body in the flow, or None.
        conditions: The free stream, or None where it is not known.
        provenance: Where the series comes from, in words.
        identity: Identifies the series, in plain JSON types: an interrupted run resumes only with the same series.
        once: Whether each snapshot can be read only once and in order, as from an iterator.
        stamp: Returns a text that changes when the files of a snapshot are written again, by its number; None where
            there are no files.
    """

    get: Callable[[int], Any]
    time: np.ndarray
    mesh: GridMesh | QuadMesh | None
    ambient_density: float | None
    body: Body | SolidBody | None = None
    conditions: FreeStream | None = None
    provenance: str = ""
    identity: Mapping[str, Any] = field(default_factory=dict)
    once: bool = False
    stamp: Callable[[int], str] | None = None

    def __post_init__(self) -> None:
        """Check."""
        time = np.array(seconds(np.asarray(self.time))).reshape(-1)
        if not np.isfinite(time).all():
            raise ValueError("the times of a series must be finite numbers, in seconds")
        if (np.diff(time) <= 0.0).any():
            first = int(np.argmax(np.diff(time) <= 0.0)) + 1
            raise ValueError(
                f"the times of a series must increase: snapshot {first} is at {time[first]:g} s, after "
                f"{time[first - 1]:g} s; sort the snapshots, or give time="
            )
        time.setflags(write=False)
        object.__setattr__(self, "time", time)
        if self.ambient_density is not None:
            check_density(self.ambient_density, "ambient_density")

    def __len__(self) -> int:
        """Number of snapshots."""
        return len(self.time)

    def __getitem__(self, index: int) -> DensityField:
        """Return a snapshot."""
        number = self._number(index)
        return self.field(self.read(number), number)

    def __iter__(self) -> Iterator[DensityField]:
        """Return an iterator over the snapshots."""
        return (self[number] for number in range(len(self)))

    def density(self, index: int) -> np.ndarray:
        """Return the densities of a snapshot [kg/m3] as they are stored, float32 or float64, in the mesh's order.

        Raises:
            IndexError: No such snapshot.
            ValueError: A shape other than the mesh's.
        """
        result = self.read(index)
        density = getattr(result, "density", None) if isinstance(result, DensityField) else result
        if density is None:
            raise ValueError(f"snapshot {index} is a {type(result).__name__}, which has no samples")
        return np.asarray(density)

    def read(self, index: int) -> Any:
        """Return a snapshot as its source gives it: an array of densities on the series' mesh, or a DensityField."""
        number = self._number(index)
        result = self.get(number)
        if isinstance(result, DensityField):
            return result
        array = host_array(result)
        if self.once:  # a solver may compute its next snapshot in the same memory while this one is processed
            array = array.copy()
        if isinstance(self.mesh, GridMesh) and tuple(array.shape) != self.mesh.shape:
            raise ValueError(
                f"snapshot {number} has shape {array.shape}, the first one {self.mesh.shape}: one mesh, one shape"
            )
        return array

    def mark(self, index: int = 0) -> str:
        """Return a hash of a snapshot's samples; empty for a formula, and after the first snapshot of an iterator."""
        number = self._number(index)
        if isinstance(self.get, InOrder) and number > 0:
            return ""
        return mark_of(self.get.first() if isinstance(self.get, InOrder) else self.get(number))

    def lies_here(self, flow: DensityField) -> bool:
        """Return whether a field has its samples on the series' mesh, and a body exactly if the series has one."""
        alike = self.mesh is not None and self.mesh.equals(mesh_of(flow))
        return alike and (flow.body is None) == (self.body is None)

    def _number(self, index: int) -> int:
        if isinstance(index, bool) or not isinstance(index, (int, np.integer)):
            raise TypeError(f"a series is indexed by whole numbers, got {index!r}")
        number = int(index) + (len(self) if index < 0 else 0)
        if not 0 <= number < len(self):
            raise IndexError(f"snapshot {index} of a series of {len(self)}")
        return number

    def field(self, density: Any, number: int) -> DensityField:
        """Return the density field of a snapshot that `read` returned."""
        if isinstance(density, DensityField):
            return density
        density, mesh, ambient = host_array(density), self.mesh, self.ambient_density
        assert ambient is not None  # open_series requires it for arrays
        described = f"{self.provenance}, snapshot {number} at {self.time[number]:g} s".lstrip(", ")
        own = self.body, self.conditions, described
        if isinstance(mesh, GridMesh):
            return GridDensity(density, mesh.origin, mesh.spacing, mesh.geometry, ambient, mesh.cell_averages, *own)
        assert isinstance(mesh, QuadMesh) and not isinstance(self.body, SolidBody)  # only volumes have a SolidBody
        at_vertices = density.size == len(mesh.vertices) and density.size != len(mesh.cells)
        return (VertexDensity if at_vertices else CellDensity)(mesh, density, ambient, *own)  # type: ignore[arg-type]


def mark_of(result: Any) -> str:
    """Return a hash of the samples of a snapshot, and of where a density field has them; empty for a formula."""
    arrays = [getattr(result, "density", None) if isinstance(result, DensityField) else host_array(result)]
    if arrays[0] is None:
        return ""
    if isinstance(result, GridDensity):
        arrays += [result.origin, result.spacing]
    elif isinstance(result, (CellDensity, VertexDensity)):
        arrays.append(result.mesh.vertices)
    samples = hashlib.sha256()
    for array in arrays:
        flat = np.asarray(array).reshape(-1)
        # About a million samples distinguish one series from another.
        samples.update(flat[:: max(1, flat.size // (1 << 20))].tobytes())
    return samples.hexdigest()[:16]


def mesh_of(flow: DensityField) -> GridMesh | QuadMesh | None:
    """Return the grid or mesh on which the samples of a density field are given; None for a formula."""
    if isinstance(flow, GridDensity):
        return GridMesh(flow.geometry, flow.origin, flow.spacing, flow.density.shape, flow.cell_averages)
    return flow.mesh if isinstance(flow, (CellDensity, VertexDensity)) else None


class InOrder:
    """The items of an iterator by their number, each available once and in order."""

    def __init__(self, items: Iterable[Any]):
        """Start at the first item."""
        self._items, self._next = iter(items), 0
        self._ahead: list[Any] = []

    def first(self) -> Any:
        """Return the first item, which can still be read afterwards."""
        if self._next:
            raise ValueError("snapshot 0 was read before")
        if not self._ahead:
            self._ahead = [self(0)]
            self._next = 0
        return self._ahead[0]

    def __call__(self, number: int) -> Any:
        """Return the item of a number."""
        if number < self._next:
            raise ValueError(
                f"snapshot {number} was read before or skipped: an iterator gives each once, in order; give a "
                "list, or start it anew"
            )
        item = None
        while self._next <= number:
            try:
                item = self._ahead.pop() if self._ahead else next(self._items)
            except StopIteration:
                raise ValueError(
                    f"the iterator ended before snapshot {self._next}: fewer snapshots than times"
                ) from None
            self._next += 1
        return item


def on_known_geometry(flow: DensityField, known: Sequence[DensityField]) -> DensityField:
    """Return a flow with its mesh and body replaced by the equal mesh and body of a known flow, where there are such.

    What is computed from a mesh or a body is cached on that object, and is then not computed again.
    """
    if not isinstance(flow, SampledDensity):
        return flow
    shared: dict[str, Any] = {}
    for name in ("mesh", "body"):
        own = getattr(flow, name, None)
        for other in (getattr(each, name, None) for each in known):
            if own is not None and other is not own and own.equals(other):
                shared[name] = other
    return replace(flow, **shared) if shared else flow  # type: ignore[type-var]
