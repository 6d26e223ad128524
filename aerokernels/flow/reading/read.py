"""`flow.read`: read a CFD file or case as a density field."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import EXPONENTS, is_no_unit, unit_in_name, written_unit

from ...inputs.checks import check_choice, check_positive
from ...inputs.units import quantity
from ...medium import Body
from ..density_field import CellDensity, DensityField
from ..gas import check_density
from ..sampled_density import VertexDensity
from .block_checks import check_blocks, check_repeated_blocks, with_blanks
from .dataset import DAMAGED, Dataset, ReadError, grid_of, wall_patches, with_all_points
from .density import DensityChoice, Reference, block_density, choose_density
from .far_field import front_of
from .flow_direction import direction_note
from .formats import OPTIONS, load
from .fractions import Fractions, choose_fractions
from .frame import Frame, plane_normal
from .gas_law import said_of_units
from .planes.one_cell_thick import flattened
from .planes.plane import Plane, plane_in_words, plane_mesh
from .planes.wall_values import wall_density
from .planes.wedges import wedge

if TYPE_CHECKING:
    from .volumes.resampling import Resampling

GEOMETRIES = ("planar", "axisymmetric", "volume")
SI_UNITS = {"density": "kg/m3", "pressure": "Pa", "temperature": "K"}


@dataclass(frozen=True, eq=False)
class Reading:
    """A file that was read, with the choice of its density, its geometry and its frame.

    Attributes:
        path: The file or case.
        dataset: Its contents.
        densities: Density [kg/m3] of each block, float64 or the file's float32, and whether its values belong to
            "cell"s or "point"s.
        geometry: "planar", "axisymmetric" or "volume".
        frame: The optical frame in the file's axes.
        normal: Normal of the plane of a planar file, in the file's axes.
        scale: The file's unit of length [m].
        ambient: The density around the field that the caller requested [kg/m3], or None.
        said: Description of the choices made, for the provenance.
        choice: The arrays that the density comes from.
        reference: Reference values of non-dimensional data.
        fractions: Mass fractions of the species, or None for a single gas.
    """

    path: Path
    dataset: Dataset
    densities: list[tuple[np.ndarray, str]]
    geometry: str
    frame: Frame
    normal: np.ndarray | None
    scale: float
    ambient: float | None
    said: str
    choice: DensityChoice
    reference: Reference
    fractions: Fractions | None = None

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Return points of the file, shape (n, 3), in the optical frame [m]."""
        axes, origin = self.frame.axes(), np.array(self.frame.origin)
        if not (origin.any() or (axes - np.eye(3)).any()):  # do not copy the points of large files
            return points if self.scale == 1.0 else self.scale * points
        return self.scale * ((points - origin) @ axes.T)

    def described(self) -> list[str]:
        """Describe the choices made for a volume, one item a choice."""
        dataset = self.dataset
        time = [f"t = {dataset.time:g}"] if dataset.time is not None else []
        axes = self.frame.axes()
        ready = all(isinstance(block.cell_data, dict) for block in dataset.blocks)  # not fields that would be read now
        direction = direction_note(self.path, dataset, self.frame, axes) if ready else []
        return [dataset.format, *time, self.said, self.frame.described(axes), *direction, *dataset.notes]


@dataclass(eq=False)
class SharedMesh:
    """Data that successive files on the same mesh share.

    Attributes:
        resampling: The map from the mesh of a volume to its grid.
    """

    resampling: "Resampling | None" = None


def read(
    path,
    *,
    density=None,
    frame=None,
    length_unit: str | float | None = None,
    reference=None,
    time: float | str | None = None,
    gas_constant: float | None = None,
    geometry: str | None = None,
    ambient_density: float | None = None,
    spacing: float | None = None,
    region=None,
    walls=None,
    species=None,
    **options: Any,
) -> DensityField:
    """Read a CFD file or case as a density field in the optical frame.

    Two-dimensional files keep their mesh; volumes are resampled to a uniform grid, with a measured error.

    Args:
        path: An OpenFOAM case, or a file: VTK's family, CGNS, Plot3D, Tecplot, SU2, NPZ, NetCDF, HDF5, CSV.
        density: Name of the density array; or {"pressure": NAME, "temperature": NAME, "gas_constant": R}; None searches
            for the usual names.
        frame: A `Frame`, a mapping of its attributes, or the optical axis alone, such as "-x".
        length_unit: Unit of the file's coordinates: "mm", or metres as a number. None takes the unit stated in the file
            or in the names of its coordinates, else metres.
        reference: Reference values of a non-dimensional file: {"density": 1.225, "length": "50 mm", ...}, or the
            reference density alone; "operating_pressure" is added to gauge pressures.
        time: "latest" (None), "first" or a time of the file.
        gas_constant: [J/(kg K)], for pressure and temperature; None takes the file's, or air's.
        geometry: "axisymmetric" for a plane file whose x is the axis and whose y is the radius; "volume" to keep a mesh
            that is one cell thick as a volume; None decides by the file.
        ambient_density: Density around the field [kg/m3]; None takes the median density at the upstream end.
        spacing: Greatest node spacing of a volume's grid [m]; None follows from the size of the cells.
        region: Lowest and highest corner of a volume's grid [m], in the optical frame; None takes the whole volume.
        walls: Names of the boundary patches that bound the body; None takes those that the file marks as walls.
        species: Mass fractions that make the field a mixture, from arrays of the file: True for those named
            by formulas (N2, Y_O2, MassFractionCO2, ...), formulas alone, or {"N2": "Y_N2", ...}, where an entry
            "basis": "mole" declares mole fractions. None assumes a single gas. See `SPECIES_NAMES`.
        options: For single formats: `mesh` (a restart of SU2), `solution` (Plot3D), `variables` (NPZ, HDF5), and
            `order` (NPZ, HDF5): the axes of the arrays, "yx" for those of numpy.meshgrid; None takes "xyz", "xy" or
            "rz" where lengths do not tell, with a warning.

    Returns:
        A density field; its `provenance` describes the choices made.

    Raises:
        TypeError: An argument of the wrong kind.
        ValueError: A file that cannot be used (`ReadError`: file, place and remedy), or arguments that do not fit it.
    """
    return read_onto(
        None, path, density=density, frame=frame, length_unit=length_unit, reference=reference, time=time,
        gas_constant=gas_constant, geometry=geometry, ambient_density=ambient_density, spacing=spacing, region=region,
        walls=walls, species=species, **options,
    )  # fmt: skip


def read_onto(shared: SharedMesh | None, path, *, spacing=None, region=None, walls=None, **asked: Any) -> DensityField:
    """Read as `read` does, and share with other files what depends on the mesh alone, through `shared`."""
    try:
        flat = spacing is None and region is None  # a mesh one cell thick is planar unless a grid is requested
        return field_of(prepare(path, flat=flat, **asked), spacing, region, walls, shared)
    except (ArithmeticError, LookupError) as fault:
        # Readers check counts and indices; an error that still occurs here means that the file is damaged.
        what = f"no field can be made of it ({type(fault).__name__}: {fault})"
        raise ReadError(path, what, DAMAGED) from fault
    except MemoryError:
        raise ReadError(
            path, "it takes more memory than there is", "give a greater spacing or a smaller region"
        ) from None


def prepare(path, *, density=None, frame=None, length_unit=None, reference=None, time=None, gas_constant=None,
            geometry=None, ambient_density=None, species=None, flat=True, **options: Any) -> Reading:  # fmt: skip
    """Read a file and decide what its arrays and axes mean; arguments and errors as in `read`."""
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(
            f"path must be the path of a flow file or case, got {type(path).__name__}: for arrays there are "
            "DensityField.from_xarray and DensityField.from_pyvista"
        )
    path = Path(path)
    frame, reference = Frame.of(frame), Reference.of(reference)
    unit = length_unit_given(length_unit, reference)
    if geometry is not None:
        check_choice(geometry, "geometry", GEOMETRIES)
    if ambient_density is not None:
        check_density(ambient_density, "ambient_density")
    if unknown := set(options) - set(OPTIONS):
        raise TypeError(f"flow.read has no argument {sorted(unknown)[0]!r}")
    return reading_of(
        path, load(path, time, options), density, frame, unit, reference, gas_constant, geometry, ambient_density,
        species, flat,
    )  # fmt: skip


def reading_of(
    path, dataset: Dataset, density, frame, unit, reference, gas_constant, geometry, ambient, species=None, flat=True
) -> Reading:
    """Decide what the arrays and axes of a dataset mean.

    `unit` is the unit of length [m], or None for the file's own; the other arguments are as in `read`. If `flat`, a
    mesh that is one cell thick is taken as planar.
    """
    if dataset.unsure:
        warn_caller(f"{path}: {dataset.unsure}")
    scale = (dataset.length or 1.0) if unit is None else unit
    check_blocks(path, dataset)
    dataset = with_blanks(dataset)
    solid = len(dataset.blocks) == 1 and grid_of(dataset.blocks[0].points) is not None
    if not solid:
        dataset = with_all_points(dataset)
    if flat and not solid and dataset.geometry is None and geometry != "volume":
        dataset = flattened(dataset, frame.look) or dataset
    choice = choose_density(path, dataset, density, gas_constant)
    if reference.operating_pressure and choice.pressure is None:
        fault = f"an operating pressure is given, but the density is {choice.density!r}"
        raise ReadError(path, fault, "leave it out, or name the arrays of pressure and temperature")
    densities = [block_density(path, block, choice, reference, dataset.units) for block in dataset.blocks]
    check_repeated_blocks(path, dataset.blocks, densities)
    normal = None
    kind = dataset.geometry or geometry
    if not solid and (kind is None or kind == "planar" or geometry is not None):
        every = [block.points for block in dataset.blocks]
        normal = plane_normal(every[0] if len(every) == 1 else np.concatenate(every))
    kind = kind or ("volume" if normal is None else "planar")
    if geometry is not None and geometry != kind:
        if dataset.geometry is not None and geometry != "axisymmetric":
            raise ReadError(path, f"the file is {kind}, not {geometry}", "leave geometry out")
        kind = geometry
    if kind == "volume" and normal is not None:
        raise ReadError(path, "its points are in a plane: it is not a volume", "leave geometry out")
    if (kind == "planar" or geometry == "axisymmetric") and normal is None and dataset.geometry != "axisymmetric":
        _refuse_wedge(path, dataset)
        raise ReadError(path, f"its points fill a volume, it is not {kind}", "leave geometry out")
    if kind == "volume" and geometry is None:
        _refuse_wedge(path, dataset)
    fractions = choose_fractions(path, dataset, densities, species)
    said = choice.described(reference) + (f"; {fractions.said}" if fractions is not None else "")
    if unit is None and scale != 1.0:
        said += f"; coordinates in units of {scale:g} m, which the file states"
    said += _without_units(dataset, choice, reference, unit)
    said += said_of_units(path, dataset, choice, reference, densities)
    return Reading(path, dataset, densities, kind, frame, normal, scale, ambient, said, choice, reference, fractions)


def _refuse_wedge(path, dataset: Dataset) -> None:
    """Raise ReadError for a wedge that stands for a flow of revolution: light would cross its sector alone."""
    every = [block.points for block in dataset.blocks]
    if grid_of(every[0]) is not None:  # which fills a volume
        return
    if (found := wedge(every[0] if len(every) == 1 else np.concatenate(every))) is not None:
        axis, angle = "xyz"[found.axis], np.degrees(found.angle)
        raise ReadError(
            path,
            f"all its points are on two planes that meet in the {axis} axis at {angle:.3g} degrees: a wedge, one cell "
            "thick, of an axisymmetric flow, whose values differ from side to side",
            "give a plane through the axis with geometry = 'axisymmetric' (ParaView's Slice, midway between them), "
            "or geometry = 'volume' for the wedge alone",
        )


def _without_units(dataset: Dataset, choice: DensityChoice, reference: Reference, unit: float | None) -> str:
    """Say which numbers are taken in SI although neither the file nor the caller states their unit."""
    taken = [
        f"{name!r} in {SI_UNITS[dimension]}"
        for dimension in SI_UNITS
        if (name := getattr(choice, dimension)) is not None
        and not (dimension in reference.given or unit_in_name(name))
        and is_no_unit(dataset.units.get(name, ""))
    ]
    if unit is None and dataset.length is None:
        taken.append("coordinates in m")
    return f"; no unit is stated, taken: {', '.join(taken)}" if taken else ""


def field_of(reading: Reading, spacing=None, region=None, walls=None, shared: SharedMesh | None = None) -> DensityField:
    """Return the density field of a file that was read."""
    if reading.geometry == "volume":
        from .volumes.volume import volume_field

        return volume_field(reading, spacing, region, walls, shared)
    if spacing is not None or region is not None:
        raise ValueError(f"spacing and region are a volume's grid; {reading.path} keeps its own mesh: leave them out")
    return _plane_field(reading, walls)


def _plane_field(reading: Reading, names=None) -> DensityField:
    path, dataset = reading.path, reading.dataset
    plane = Plane.of(path, dataset, reading.geometry, reading.frame, reading.scale, reading.normal)
    given = [(np.asarray(rho, np.float64), where) for rho, where in reading.densities]
    fractions = reading.fractions
    if fractions is not None:  # partial densities are carried to the mesh in the same way as the density
        parts = zip(given, fractions.blocks, strict=True)
        given = [(np.vstack([rho, rho * shares]).T, where) for (rho, where), shares in parts]
    mesh, density, where, remark = plane_mesh(path, list(dataset.blocks), plane, given)
    composition = None
    body = _body(path, dataset, plane, mesh, names)
    at = mesh.cell_centroid if where == "cell" else mesh.vertices
    if fractions is not None:
        partial, density = density[:, 1:].T, density[:, 0]
        composition = fractions.composition(partial, partial[:, front_of(at)].mean(axis=1))
    ambient = reading.ambient or dataset.ambient or float(np.median(density[front_of(at)]))
    said = [dataset.format, *([f"t = {dataset.time:g}"] if dataset.time is not None else []), reading.said,
            plane_in_words(plane, reading.frame, mesh), *direction_note(path, dataset, reading.frame, plane.axes),
            f"ambient {ambient:.6g} kg/m3", *([remark] if remark else []), *dataset.notes]  # fmt: skip
    wall = None
    if where == "cell" and fractions is None:
        wall = wall_density(path, dataset, plane, reading.choice, reading.reference, names)
        said += [f"values at {len(wall.density)} points of the walls"] if wall is not None else []
    provenance = f"{path}: {'; '.join(said)}"
    try:
        if where == "cell":
            return CellDensity(mesh, density, ambient, body, None, provenance, composition=composition, wall=wall)
        return VertexDensity(mesh, density, ambient, body, None, provenance, composition=composition)
    except ValueError as fault:
        raise ReadError(path, str(fault), "see what the file holds with `aerokernels fields`") from None


def _body(path, dataset: Dataset, plane: Plane, mesh, names) -> Body | None:
    from .planes.walls import hole_body, wall_body

    walls = wall_patches(path, dataset.patches, names)
    edges = [plane.local(patch.edges) for patch in walls if len(patch.edges)]
    try:
        return wall_body(np.concatenate(edges), mesh) if edges else hole_body(mesh)
    except ValueError as fault:
        raise ReadError(path, f"its walls make no body: {fault}", "repair the boundary's patches") from None


def unit_of_length(unit: str | float | None) -> float:
    """Return a unit of length [m] given as its name, as a quantity such as "2.5 mm", or in metres.

    Raises:
        ValueError: Not a length, or a length that is not positive.
    """
    if unit is None:
        return 1.0
    if isinstance(unit, str) and (written := written_unit(unit)) and written.exponents == EXPONENTS["length"]:
        return written.factor
    if isinstance(unit, str) and not any(c.isdigit() for c in unit):
        unit = f"1 {unit}"
    return check_positive(quantity(unit, "length"), "length_unit")


def length_unit_given(unit: str | float | None, reference: Reference) -> float | None:
    """Return the unit of length [m] that a caller gives by `length_unit`, a reference length or both, or None."""
    if unit is None and "length" not in reference.given:
        return None
    return unit_of_length(unit) * reference.length
