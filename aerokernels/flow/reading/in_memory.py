"""Density fields from flows in memory: xarray data sets and arrays, pyvista and VTK grids."""

from typing import Unpack

import numpy as np

from aerokernels.flow.density_field import DensityField
from aerokernels.flow.reading.arrays import ambient_attribute, stated_unit, unit_of_array
from aerokernels.flow.reading.formats import FORMAT_OPTIONS, checked_time
from aerokernels.flow.reading.read import ReadOptions, checked_options, field_of, reading_of


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
    found = vtk_dataset(f"{dataset.GetClassName()} given", dataset, "VTK data set")
    return field_of(reading_of("pyvista data", found, asked))
