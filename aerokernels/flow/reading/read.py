"""`flow.read` and `flow.Reader`: read a CFD file or case, or data in memory, as a density field."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

import numpy as np

from aerokernels.flow.density_field import DensityField
from aerokernels.flow.gas import check_density
from aerokernels.flow.reading.arrays import ambient_attribute, stated_unit, unit_of_array
from aerokernels.flow.reading.checks import check_blocks, check_repeated_blocks, said_of_units, with_blanks
from aerokernels.flow.reading.dataset import DAMAGED, Dataset, ReadError, grid_of, wall_patches, with_all_points
from aerokernels.flow.reading.density import DensityChoice, Reference, choose_density
from aerokernels.flow.reading.formats import FORMAT_OPTIONS, checked_time, load
from aerokernels.flow.reading.fractions import Fractions, choose_fractions
from aerokernels.flow.reading.frame import Frame, direction_note, plane_normal
from aerokernels.flow.reading.planes.one_cell_thick import flattened, wedge
from aerokernels.flow.reading.planes.plane import Plane, hole_body, plane_in_words, plane_mesh, wall_body, wall_density
from aerokernels.flow.sampled_density import CellDensity, VertexDensity
from aerokernels.inputs.checks import check_choice, check_positive, warn_caller
from aerokernels.inputs.units import EXPONENTS, is_no_unit, quantity, unit_in_name, written_unit
from aerokernels.medium import Body

if TYPE_CHECKING:
    from aerokernels.flow.reading.volumes.resampling import Resampling


class ReadOptions(TypedDict, total=False):
    """The options of `read`, which describes them; None and an option left out mean the same."""

    density: str | Mapping[str, Any] | None
    frame: Frame | Mapping[str, Any] | str | None
    length_unit: str | float | None
    reference: Reference | Mapping[str, Any] | str | float | None
    time: float | str | None
    gas_constant: float | None
    geometry: str | None
    ambient_density: float | None
    species: bool | Sequence[str] | Mapping[str, str] | None
    spacing: float | Sequence[float] | None
    region: Sequence[Sequence[float]] | None
    walls: str | Sequence[str] | None
    mesh: str | os.PathLike | None
    solution: str | os.PathLike | None
    variables: Mapping[str, Any] | None
    order: str | None


def checked_options(options: ReadOptions, taker: str, *, without: Sequence[str] = ()) -> ReadOptions:
    """Return options in their own types: a `Frame`, a `Reference`, metres; those left out as None."""
    known = [name for name in ReadOptions.__annotations__ if name not in without]
    if unknown := sorted(set(options) - set(known)):
        raise TypeError(f"{taker} has no argument {unknown[0]!r}: it takes {', '.join(known)}")
    values: dict[str, Any] = {name: options.get(name) for name in ReadOptions.__annotations__}
    values["frame"], values["reference"] = Frame.of(values["frame"]), Reference.of(values["reference"])
    if values["length_unit"] is not None or "length" in values["reference"].stated:
        values["length_unit"] = unit_of_length(values["length_unit"]) * values["reference"].length
    if values["geometry"] is not None:
        check_choice(values["geometry"], "geometry", ("planar", "axisymmetric", "volume"))
    if values["ambient_density"] is not None:
        check_density(values["ambient_density"], "ambient_density")
    return cast(ReadOptions, values)


@dataclass(frozen=True, eq=False)
class Reading:
    """A file that was read, with the choice of its density, its geometry and its frame."""

    path: Path
    dataset: Dataset
    options: ReadOptions  # as `checked_options` returns them
    # Density [kg/m3] of each block, float64 or the file's float32, and whether its values belong to "cell"s or "point"s
    densities: list[tuple[np.ndarray, str]]
    geometry: str  # "planar", "axisymmetric" or "volume"
    normal: np.ndarray | None  # of the plane of a planar file, in the file's axes
    scale: float  # the file's unit of length [m]
    said: str  # description of the choices made, for the provenance
    choice: DensityChoice  # the arrays that the density comes from
    fractions: Fractions | None = None  # mass fractions of the species, or None for a single gas

    @property
    def frame(self) -> Frame:
        """The optical frame in the file's axes."""
        return cast(Frame, self.options["frame"])

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Return points of the file, shape (n, 3), in the optical frame [m]."""
        axes, origin = self.frame.axes(), np.array(self.frame.origin)
        if not (origin.any() or (axes - np.eye(3)).any()):  # do not copy the points of large files
            return points if self.scale == 1.0 else self.scale * points
        return self.scale * ((points - origin) @ axes.T)

    def described(self) -> list[str]:
        """Describe the choices made for a volume, one item a choice."""
        dataset = self.dataset
        axes = self.frame.axes()
        ready = all(isinstance(block.cell_data, dict) for block in dataset.blocks)  # not fields that would be read now
        direction = direction_note(self, axes) if ready else []
        return [*self.opening(), self.frame.described(axes), *direction, *dataset.notes]

    def opening(self) -> list[str]:
        """Return what every description begins with: the format, the time, the arrays."""
        time = [f"t = {self.dataset.time:g}"] if self.dataset.time is not None else []
        return [self.dataset.format, *time, self.said]


def read(path, **options: Unpack[ReadOptions]) -> DensityField:
    """Read a CFD file or case as a density field in the optical frame.

    Two-dimensional files keep their mesh; volumes are resampled to a uniform grid, with a measured error.

    Args:
        path: An OpenFOAM case, or a file: VTK's family, CGNS, EnSight, Fluent, Exodus, Plot3D, Tecplot, SU2,
            NPZ, NetCDF, HDF5, CSV.
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
        mesh: The mesh of a restart of SU2.
        solution: The solution of a grid of Plot3D, or the restart of a mesh of SU2.
        variables: Names of the coordinates in NPZ, HDF5 and NetCDF, or the two ends of each axis: {"x": "X1", ...}.
        order: The axes of the arrays in NPZ and HDF5: "yx" for those of numpy.meshgrid; None takes "xyz", "xy" or
            "rz" where lengths do not tell, with a warning.

    Returns:
        A density field; its `provenance` describes the choices made.

    Raises:
        TypeError: An argument of the wrong kind.
        ValueError: A file that cannot be used (`ReadError`: file, place and remedy), or arguments that do not fit it.
    """
    return Reader(**options)(path)


class Reader:
    """`flow.read` with its options given once, for files or times that share a mesh.

    The map from the mesh of a volume to its grid is computed once; each further snapshot on the same mesh costs the
    reading of its file and one pass over cells and nodes. A file with another mesh gets a new map, which replaces the
    previous one.

        reader = flow.Reader(spacing=1e-3)
        fields = [reader("case", time=t) for t in (0.1, 0.2, 0.3)]
        field = reader.resampling.apply(densities)  # of the same cells, from a solver in this process

    Attributes:
        options: Those of `flow.read`.
        resampling: The map from the mesh of the last volume to its grid; None before the first and for other
            geometries.
    """

    def __init__(self, **options: Unpack[ReadOptions]):
        """Store the options, which are those of `flow.read`."""
        self.options = options
        self.resampling: Resampling | None = None

    def __call__(self, path, **more: Unpack[ReadOptions]) -> DensityField:
        """Read a file or case; `more` overrides the stored options. Errors as in `flow.read`."""
        if not isinstance(path, (str, os.PathLike)):
            raise TypeError(
                f"path must be the path of a flow file or case, got {type(path).__name__}: for arrays there are "
                "DensityField.from_xarray and DensityField.from_pyvista"
            )
        options = checked_options({**self.options, **more}, "flow.read")
        of_format = {name: value for name, value in options.items() if name in FORMAT_OPTIONS}
        try:
            dataset = load(Path(path), options["time"], of_format)
            return field_of(reading_of(Path(path), dataset, options), self)
        except (ArithmeticError, LookupError) as fault:
            # Readers check counts and indices; an error that still occurs here means that the file is damaged.
            what = f"no field can be made of it ({type(fault).__name__}: {fault})"
            raise ReadError(path, what, DAMAGED) from fault
        except MemoryError:
            remedy = "give a greater spacing or a smaller region"
            raise ReadError(path, "it takes more memory than there is", remedy) from None


def reading_of(path, dataset: Dataset, options: ReadOptions) -> Reading:
    """Decide what the arrays and axes of a dataset mean; `options` as of `checked_options`, errors as in `read`."""
    frame, reference = cast(Frame, options["frame"]), cast(Reference, options["reference"])
    geometry = options["geometry"]
    flat = options["spacing"] is None and options["region"] is None  # else a mesh one cell thick is a volume
    if dataset.unsure:
        warn_caller(f"{path}: {dataset.unsure}")
    scale = cast("float | None", options["length_unit"]) or dataset.length or 1.0
    check_blocks(path, dataset.blocks)
    dataset = with_blanks(dataset)
    solid = len(dataset.blocks) == 1 and grid_of(dataset.blocks[0].points) is not None
    if not solid:
        dataset = with_all_points(dataset)
    if flat and not solid and dataset.geometry is None and geometry != "volume":
        dataset = flattened(dataset, frame.look) or dataset
    choice = choose_density(path, dataset, options["density"], options["gas_constant"], reference)
    if reference.operating_pressure and choice.pressure is None:
        fault = f"an operating pressure is given, but the density is {choice.density!r}"
        raise ReadError(path, fault, "leave it out, or name the arrays of pressure and temperature")
    densities = [choice.of_block(block) for block in dataset.blocks]
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
    fractions = choose_fractions(path, dataset, densities, options["species"])
    said = choice.described() + (f"; {fractions.said}" if fractions is not None else "")
    if options["length_unit"] is None and scale != 1.0:
        said += f"; coordinates in units of {scale:g} m, which the file states"
    said += _without_units(dataset, choice, options["length_unit"] is not None)
    said += said_of_units(path, dataset, choice, densities)
    return Reading(path, dataset, options, densities, kind, normal, scale, said, choice, fractions)


def _refuse_wedge(path, dataset: Dataset) -> None:
    """Raise ReadError for a wedge that stands for a flow of revolution: light would cross its sector alone."""
    every = [block.points for block in dataset.blocks]
    if grid_of(every[0]) is not None:  # which fills a volume
        return
    if (result := wedge(every[0] if len(every) == 1 else np.concatenate(every))) is not None:
        axis, angle = "xyz"[result.axis], np.degrees(result.angle)
        raise ReadError(
            path,
            f"all its points are on two planes that meet in the {axis} axis at {angle:.3g} degrees: a wedge, one cell "
            "thick, of an axisymmetric flow, whose values differ from side to side",
            "give a plane through the axis with geometry = 'axisymmetric' (ParaView's Slice, midway between them), "
            "or geometry = 'volume' for the wedge alone",
        )


def _without_units(dataset: Dataset, choice: DensityChoice, has_length: bool) -> str:
    """Say which numbers are taken in SI although neither the file nor the caller states their unit."""
    units = {"density": "kg/m3", "pressure": "Pa", "temperature": "K"}
    taken = [
        f"{name!r} in {units[dimension]}"
        for dimension, name in choice.names.items()
        if not (dimension in choice.reference.stated or unit_in_name(name)) and is_no_unit(dataset.units.get(name, ""))
    ]
    if not has_length and dataset.length is None:
        taken.append("coordinates in m")
    return f"; no unit is stated, taken: {', '.join(taken)}" if taken else ""


def field_of(reading: Reading, shared: Reader | None = None) -> DensityField:
    """Return the density field of a file that was read; `shared` keeps the map from a volume's mesh to its grid."""
    if reading.geometry == "volume":
        from aerokernels.flow.reading.volumes.volume import volume_field

        return volume_field(reading, shared)
    if reading.options["spacing"] is not None or reading.options["region"] is not None:
        raise ValueError(f"spacing and region are a volume's grid; {reading.path} keeps its own mesh: leave them out")
    return _plane_field(reading)


def _plane_field(reading: Reading) -> DensityField:
    path, dataset = reading.path, reading.dataset
    plane = Plane.of(reading)
    samples = [(np.asarray(rho, np.float64), where) for rho, where in reading.densities]
    fractions = reading.fractions
    if fractions is not None:  # partial densities are carried to the mesh in the same way as the density
        parts = zip(samples, fractions.blocks, strict=True)
        samples = [(np.vstack([rho, rho * shares]).T, where) for (rho, where), shares in parts]
    mesh, density, where, remark = plane_mesh(path, list(dataset.blocks), plane, samples)
    composition = None
    body = _body(reading, plane, mesh)
    at = mesh.cell_centroid if where == "cell" else mesh.vertices
    if fractions is not None:
        partial, density = density[:, 1:].T, density[:, 0]
        composition = fractions.composition(partial, partial[:, front_of(at)].mean(axis=1))
    ambient = reading.options["ambient_density"] or float(np.median(density[front_of(at)]))
    direction = direction_note(reading, plane.axes)
    said = [*reading.opening(), plane_in_words(plane, reading.frame, mesh), *direction,
            f"ambient {ambient:.6g} kg/m3", *([remark] if remark else []), *dataset.notes]  # fmt: skip
    wall = None
    if where == "cell" and fractions is None:
        wall = wall_density(reading, plane)
        said += [f"values at {len(wall[1])} points of the walls"] if wall is not None else []
    provenance = f"{path}: {'; '.join(said)}"
    try:
        if where == "cell":
            return CellDensity(mesh, density, ambient, body, None, provenance, composition=composition, wall=wall)
        return VertexDensity(mesh, density, ambient, body, None, provenance, composition=composition)
    except ValueError as fault:
        raise ReadError(path, str(fault), "see what the file holds with `aerokernels fields`") from None


def _body(reading: Reading, plane: Plane, mesh) -> Body | None:
    walls = wall_patches(reading.path, reading.dataset.patches, reading.options["walls"])
    edges = [plane.local(patch.edges) for patch in walls if len(patch.edges)]
    try:
        return wall_body(np.concatenate(edges), mesh) if edges else hole_body(mesh)
    except ValueError as fault:
        raise ReadError(reading.path, f"its walls make no body: {fault}", "repair the boundary's patches") from None


def unit_of_length(unit: str | float | None) -> float:
    """Return a unit of length [m] given as its name, as a quantity such as "2.5 mm", or in metres."""
    if unit is None:
        return 1.0
    if isinstance(unit, str) and (written := written_unit(unit)) and written.exponents == EXPONENTS["length"]:
        return written.factor
    if isinstance(unit, str) and not any(c.isdigit() for c in unit):
        unit = f"1 {unit}"
    return check_positive(quantity(unit, "length"), "length_unit")


def front_of(places: np.ndarray) -> np.ndarray:
    """Return which places, shape (n, d), are in the most upstream twentieth of all."""
    return np.asarray(places[:, -1] >= float(np.quantile(places[:, -1], 0.95)))


def from_xarray(array, **options: Unpack[ReadOptions]) -> DensityField:
    """Return a density field from an xarray data set or array; options as in `flow.read`.

    Coordinates are x, y, z (volume), two of them (planar), or r, z (axisymmetric), in the unit that their attribute
    `units` names. An array is the density itself. Its attribute `ambient_density` is the density around the field: a
    number of kg/m3, or a text with a unit, as in "1.2e-3 g/cm3".
    """
    from aerokernels.flow.reading.readers.netcdf import labelled_dataset

    if not hasattr(array, "dims"):
        raise TypeError(f"from_xarray takes an xarray DataArray or Dataset, got {type(array).__name__}")
    asked = checked_options(options, "from_xarray", without=("spacing", "region", "walls", *FORMAT_OPTIONS))
    attributes = dict(array.attrs)
    if hasattr(array, "to_dataset") and hasattr(array, "values") and not hasattr(array, "data_vars"):
        name = array.name or "density"
        array, asked["density"] = array.to_dataset(name=name), asked["density"] or name
    if asked["ambient_density"] is None and attributes.get("ambient_density") is not None:
        held = next((array[name] for name in (asked["density"], "density", "rho") if name in array), None)
        stated = stated_unit(held.attrs) if held is not None else ""
        unit = unit_of_array("xarray data", "density", stated, "density").factor
        values = np.asarray(held.values) if held is not None else np.empty(0)
        asked["ambient_density"] = ambient_attribute("xarray data", attributes["ambient_density"], unit, values)
    dataset = labelled_dataset("xarray data", array, None, checked_time(asked["time"]))
    return field_of(reading_of("xarray data", dataset, asked))


def from_pyvista(dataset, **options: Unpack[ReadOptions]) -> DensityField:
    """Return a density field from a pyvista (or VTK) grid or multi-block set; options as in `flow.read`."""
    from aerokernels.flow.reading.readers.vtk_files import vtk_dataset

    if not hasattr(dataset, "GetClassName"):
        raise TypeError(f"from_pyvista takes a data set of pyvista or VTK, got {type(dataset).__name__}")
    asked = checked_options(options, "from_pyvista", without=("time", "walls", *FORMAT_OPTIONS))
    result = vtk_dataset(f"{dataset.GetClassName()} given", dataset, "VTK data set")
    return field_of(reading_of("pyvista data", result, asked))
