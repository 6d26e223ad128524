"""Convert an xarray array on an even grid to the arguments of `IndexField.from_samples`."""

from typing import Any

import numpy as np

from aerokernels.inputs.units import ratio_of, unit_of

GEOMETRIES = {("x", "y", "z"): "volume", ("y", "z"): "planar", ("r", "z"): "axisymmetric"}


def unevenness(step: float, farthest: float) -> float:
    """Return how far nodes with coordinates up to `farthest` may be off an even grid of a spacing `step`, like it."""
    # Rounding to single precision moves a node and the ends of its row by 2.4e-7 of a coordinate.
    return step * float(np.clip(2.4e-7 * farthest / step, 1e-6, 1e-3)) if step > 0.0 else 0.0


def even_nodes(place: np.ndarray, what: str, tolerance: float | None = None) -> tuple[float, float]:
    """Return the first node and the spacing of nodes [m] that increase evenly, within a share of it; refuse others."""
    if len(place) < 2:
        raise ValueError(f"{what} has {len(place)} nodes: a field needs at least two")
    step = float((place[-1] - place[0]) / (len(place) - 1))
    off = np.abs(place - (place[0] + step * np.arange(len(place))))
    most = unevenness(step, np.abs(place).max()) if tolerance is None else tolerance * step
    if not (step > 0.0 and off.max() <= most):
        raise ValueError(
            f"{what} is not even: node {int(np.argmax(off))} is {off.max():.3g} m off; interpolate to an even grid, or "
            "make a mesh of it with QuadMesh.structured"
        )
    return float(place[0]), step


def check_order(array: Any, name: str, geometry: str, door: str) -> None:
    """Reject a labelled array, such as one of xarray, whose dimensions are those of a geometry in another order."""
    axes = next((axes for axes, one in GEOMETRIES.items() if one == geometry), ())
    names = tuple(map(str, getattr(array, "dims", axes)))
    if names != axes and sorted(names) == sorted(axes):
        raise ValueError(
            f"{name} has the dimensions {', '.join(names)}, and a field {', '.join(axes)}: take "
            f"{name}.transpose({', '.join(map(repr, axes))}), or {door}, which orders them itself"
        )


def grid_arguments(array) -> dict:
    """Return the arguments; see `IndexField.from_xarray`."""
    if not hasattr(array, "dims") or not hasattr(array, "coords") or hasattr(array, "data_vars"):
        raise TypeError(f"from_xarray takes an xarray DataArray, got {type(array).__name__}: choose one of a Dataset")
    names = {str(dim): dim for dim in array.dims}
    order = next((axes for axes in GEOMETRIES if sorted(axes) == sorted(map(str, array.dims))), None)
    if order is None:
        axes = ", ".join(map(str, array.dims))
        raise ValueError(f"dimensions {axes} make no field: call them x, y, z, or y, z, or r, z")
    array = array.transpose(*(names[axis] for axis in order))
    origin, spacing = [], []
    for axis in order:
        if names[axis] not in array.coords:
            raise ValueError(f"dimension {axis} has no coordinates: assign them, in metres or with an attribute units")
        own = array.coords[names[axis]]
        if own.dtype.kind not in "iuf" or own.ndim != 1:
            raise ValueError(
                f"coordinates {axis} must be a row of numbers, got {own.dtype} of shape {own.shape}: "
                "assign them in metres"
            )
        unit = str(array.coords[names[axis]].attrs.get("units", "")).strip()
        place = np.asarray(array.coords[names[axis]].values, dtype=np.float64)
        place = place * unit_of(unit, "length").factor
        if len(place) > 1 and place[-1] < place[0]:
            array, place = array.isel({names[axis]: slice(None, None, -1)}), place[::-1]
        first, step = even_nodes(place, f"dimension {axis}")
        origin.append(first)
        spacing.append(step)
    known = ("ambient_index", "interpolation", "wavelength", "cell_averages")
    attributes = {name: array.attrs[name] for name in known if name in array.attrs}
    if (
        "cell_averages" in attributes and np.isin(attributes["cell_averages"], (0, 1)).all()
    ):  # NetCDF has no true and false
        attributes["cell_averages"] = bool(np.all(attributes["cell_averages"]))
    samples = np.asarray(array.values)
    if samples.dtype.kind not in "iuf":
        raise ValueError(f"the array holds {samples.dtype}, no real numbers: convert it")
    try:
        ratio = ratio_of(str(array.attrs.get("units", "")))
    except ValueError as fault:
        remedy = "it is n - ambient_index, a ratio; a density makes a field by DensityField.from_xarray and index_field"
        raise ValueError(f"the unit of the contrast: {fault}: {remedy}") from None
    if ratio != 1.0:
        samples = samples * ratio
    if samples.size and samples.max() > 1e3:  # no medium has greater contrasts: the file is damaged
        raise ValueError(f"no medium has a contrast of {samples.max():g}, the greatest: it is n - ambient_index")
    return {"contrast": samples, "origin": origin, "spacing": spacing, "geometry": GEOMETRIES[order], **attributes}
