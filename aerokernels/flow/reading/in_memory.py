"""Density fields from flows in memory: xarray data sets and arrays, pyvista and VTK grids."""

import numpy as np

from aerokernels.flow.reading.array_units import ambient_attribute, stated_unit, unit_of_array
from aerokernels.flow.reading.dataset import Dataset
from aerokernels.flow.reading.density import Reference
from aerokernels.flow.reading.formats import checked_time
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.read import field_of, length_unit_given, reading_of


def from_xarray(array, *, density=None, frame=None, reference=None, ambient_density=None, time=None, geometry=None,
                gas_constant=None, length_unit=None, species=None):  # fmt: skip
    """Return a density field from an xarray data set or array; arguments as in `flow.read`.

    Coordinates are x, y, z (volume), two of them (planar), or r, z (axisymmetric), in the unit that their attribute
    `units` names. An array is the density itself. Its attribute `ambient_density` is the density around the field: a
    number of kg/m3, or a text with a unit, as in "1.2e-3 g/cm3".
    """
    from aerokernels.flow.reading.readers.labelled import labelled_dataset

    if not hasattr(array, "dims"):
        raise TypeError(f"from_xarray takes an xarray DataArray or Dataset, got {type(array).__name__}")
    attributes = dict(array.attrs)
    if hasattr(array, "to_dataset") and hasattr(array, "values") and not hasattr(array, "data_vars"):
        name = array.name or "density"
        array, density = array.to_dataset(name=name), density or name
    ambient = ambient_density
    if ambient is None and attributes.get("ambient_density") is not None:
        held = next((array[name] for name in (density, "density", "rho") if name in array), None)
        stated = stated_unit(held.attrs) if held is not None else ""
        unit = unit_of_array("xarray data", "density", stated, "density").factor
        values = np.asarray(held.values) if held is not None else np.empty(0)
        ambient = ambient_attribute("xarray data", attributes["ambient_density"], unit, values)
    found = labelled_dataset("xarray data", array, None, checked_time(time))
    return _field(found, "xarray data", density, frame, reference, ambient, geometry, gas_constant, length_unit,
                  species=species)  # fmt: skip


def from_pyvista(dataset, *, density=None, frame=None, reference=None, ambient_density=None, geometry=None,
                 gas_constant=None, length_unit=None, spacing=None, region=None, species=None):  # fmt: skip
    """Return a density field from a pyvista (or VTK) grid or multi-block set; arguments as in `flow.read`."""
    from aerokernels.flow.reading.readers.vtk_files import vtk_dataset

    if not hasattr(dataset, "GetClassName"):
        raise TypeError(f"from_pyvista takes a data set of pyvista or VTK, got {type(dataset).__name__}")
    found = vtk_dataset(f"{dataset.GetClassName()} given", dataset, "VTK data set")
    return _field(found, "pyvista data", density, frame, reference, ambient_density, geometry, gas_constant,
                  length_unit, spacing, region, species)  # fmt: skip


def _field(found: Dataset, name, density, frame, reference, ambient, geometry, gas_constant, length_unit,
           spacing=None, region=None, species=None):  # fmt: skip
    references = Reference.of(reference)
    unit = length_unit_given(length_unit, references)
    taken = reading_of(
        name, found, density, Frame.of(frame), unit, references, gas_constant, geometry,
        None if ambient is None else float(ambient), species, spacing is None and region is None,
    )  # fmt: skip
    return field_of(taken, spacing, region)
