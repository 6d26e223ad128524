"""Make a run's labelled dataset with units, which is written to result.nc and from which the figures are drawn."""

import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.flow import CellDensity, DensityField
from aerokernels.jobs.run_parts import RunParts
from aerokernels.jobs.scene_text import scene_toml
from aerokernels.jobs.store import number_or_nan, to_json
from aerokernels.medium import SolidBody
from aerokernels.scene.pupil_table import axis_words

if TYPE_CHECKING:
    import xarray

RASTER_CELLS = 400  # cells along each side of the density figure of an unstructured mesh
# Numbers of the summary that are attributes of the dataset too, because the figures show them.
SHOWN = ("strehl", "range_m", "true_range_m")
WITH_ERROR = ("strehl", "range_m")  # numbers whose errors are attributes NAME_error


def variable(dims: str | tuple[str, ...], values: Any, units: str, long_name: str) -> tuple[Any, ...]:
    """Return a variable with its unit and meaning, as xarray.Dataset takes it."""
    return dims, values, {"units": units, "long_name": long_name}


def density_cells(field: DensityField) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the density of cells (i, j) [kg/m3] in the plane x = 0, and y and z of their corners (i+1, j+1) [m]."""
    if isinstance(field, CellDensity) and field.mesh.shape is not None:
        shape = field.mesh.shape
        corners = field.mesh.vertices.reshape(*shape, 2)
        return field.density.reshape(shape[0] - 1, shape[1] - 1), corners[..., 0], corners[..., 1]
    low, high = (corner[-2:] for corner in field.box)
    axes = [np.linspace(low[k], high[k], RASTER_CELLS + 1) for k in range(2)]
    middle = np.meshgrid(*(0.5 * (axis[1:] + axis[:-1]) for axis in axes), indexing="ij")
    y, z = (axis.ravel() for axis in middle)
    density = field.density_at(np.stack([np.zeros(y.size), y, z], axis=1))
    density = np.where(np.isnan(density), field.ambient_density, density)  # inside the body, which is drawn on top
    corner_y, corner_z = np.meshgrid(*axes, indexing="ij")
    return density.reshape(RASTER_CELLS, RASTER_CELLS), corner_y, corner_z


def _middle(corner: np.ndarray) -> np.ndarray:
    """Return the mean of the four corners of each cell."""
    return 0.25 * (corner[1:, 1:] + corner[:-1, 1:] + corner[1:, :-1] + corner[:-1, :-1])


def written_at() -> datetime:
    """Return the time stamp for files: now, or SOURCE_DATE_EPOCH if it is set, so that equal runs give equal files."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    known = epoch.isascii() and epoch.isdigit() and len(epoch) <= 11  # up to the year 5138
    return datetime.fromtimestamp(int(epoch), UTC) if known else datetime.now(UTC)


def run_dataset(result: RunParts, summary: Mapping[str, Any]) -> "xarray.Dataset":
    """Make the dataset of a run's arrays and its summary; arrays of a failed stage are absent.

    The times of the stages are only in summary.json, so that equal runs give equal datasets.
    """
    import xarray

    flow = result.prepared.density
    pupil, fan, spot = result.pupil, result.fan, result.spot
    variables: dict[str, Any] = {}
    if flow is not None:
        density, corner_y, corner_z = density_cells(flow)
        variables = {
            "density": variable(("cell_i", "cell_j"), density, "kg m-3", "density, cell averages"),
            # The centre of each cell, the place of its average.
            "cell_y": variable(("cell_i", "cell_j"), _middle(corner_y), "m", "y of the cells' centres"),
            "cell_z": variable(("cell_i", "cell_j"), _middle(corner_z), "m", "z of the cells' centres"),
            "density_y": variable(("corner_i", "corner_j"), corner_y, "m", "y of the cells' corners"),
            "density_z": variable(("corner_i", "corner_j"), corner_z, "m", "z of the cells' corners"),
        }
    coordinates = {"axis": variable("axis", np.array(["x", "y", "z"]), "1", "component")}
    wavelength = variable((), result.scene.flow.wavelength, "m", "vacuum wavelength of the light")
    wavelength[2]["standard_name"] = "radiation_wavelength"
    coordinates["wavelength"] = wavelength
    coordinates |= {name: variables.pop(name) for name in ("cell_y", "cell_z") if name in variables}
    first, second = axis_words(result.scene.view)
    if fan is not None:
        variables |= {
            "ray_position": variable(("ray", "plane", "axis"), fan.position, "m", "rays of the picture"),
            "ray_deviation": variable(
                ("ray", "plane"), fan.deviation, "m", f"displacement along {second} from the straight ray"
            ),
        }
    if pupil is not None:
        maps = {
            "opd": (pupil.opd, ("piston",)),
            "opd_without_tilt": (pupil.without_tilt, ("piston", "tilt")),
            "opd_without_focus": (pupil.without_focus, ("piston", "tilt", "focus")),
        }
        for map_name, (opd, removed) in maps.items():
            words = f"optical path difference, {', '.join(removed)} removed"
            variables[map_name] = variable(("pupil_y", "pupil_x"), opd, "m", words)
            # The rms of the map that the Strehl ratio is computed from is a number of the summary.
            is_summarised = set(removed) == set(result.scene.strehl.remove)
            error = pupil.opd_error
            if is_summarised:  # and what the map's pixels differ from the rays of the summary
                apart = float(np.sqrt(np.nanmean(opd**2))) - summary["opd_rms_m"]
                error = float(np.hypot(summary["errors"]["opd_rms_m"], apart))
            variables[map_name][2]["rms_error_m"] = number_or_nan(error)
        coordinates |= {
            "pupil_x": variable("pupil_x", pupil.coordinate, "m", f"along {first} in the pupil"),
            "pupil_y": variable("pupil_y", pupil.coordinate, "m", f"along {second} in the pupil"),
        }
    if spot is not None:
        variables |= {
            "point_spread": variable(
                ("angle_y", "angle_x"), spot.intensity, "1", "intensity over the undisturbed peak"
            ),
            "point_spread_perfect": variable(("angle_y", "angle_x"), spot.perfect, "1", "the same without flow"),
        }
        coordinates |= {
            "angle_x": variable("angle_x", spot.angle, "rad", f"angle toward {first}"),
            "angle_y": variable("angle_y", spot.angle, "rad", f"angle toward {second}"),
        }
    body = result.prepared.field.body
    if isinstance(body, SolidBody):
        variables["body_point"] = variable(("body_vertex", "axis"), body.vertices, "m", "points of the body's surface")
        variables["body_triangle"] = variable(
            ("body_face", "corner"), body.triangles, "1", "corners of its triangles, by the number of their point"
        )
    elif body is not None:
        variables["body_y"] = variable("body_vertex", body.profile[:, 0], "m", "y of the body's outline")
        variables["body_z"] = variable("body_vertex", body.profile[:, 1], "m", "z of the body's outline")
    numbers = {name: value for name, value in to_json(summary).items() if not name.endswith("seconds")}
    attributes = {
        "Conventions": "CF-1.11",
        "title": result.scene.title or result.scene.name,
        "history": f"{written_at():%Y-%m-%dT%H:%M:%SZ}: made by aerokernels {numbers['version']}",
        "source": f"aerokernels {numbers['version']}",
        "geometry": result.prepared.field.geometry,
        "pupil_axes": [first, second],
        "flow_front_m": result.prepared.front,
        **({} if flow is None else {"ambient_density": flow.ambient_density}),
        "threshold_v": result.scene.detector.threshold,
        "scene": scene_toml(result.scene),
        "summary": json.dumps(numbers),
        **{name: number_or_nan(numbers[name]) for name in SHOWN},
        **{f"{name}_error": number_or_nan(numbers["errors"][name]) for name in WITH_ERROR},
    }
    if result.scene.detector.ranging != "leading-edge":
        del attributes["threshold_v"]  # the other methods use no fixed level
    if result.echo is None:
        return xarray.Dataset(variables, coordinates, attributes)
    echo = result.echo.to_xarray()
    attributes |= {name: value for name, value in echo.attrs.items() if name not in numbers and "seconds" not in name}
    echo = echo.drop_vars("axis", errors="ignore")
    for label in echo.variables:
        echo[label].attrs.setdefault("units", "1")  # labels have no unit
    return xarray.Dataset(variables, coordinates, attributes).merge(echo, combine_attrs="override")
