"""Draw the figures of a run from its stored dataset alone, so that a `result.nc` can be drawn again at any time.

Each function returns a Matplotlib figure without window or global state. The dataset is in SI units.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import extent_of, is_flat, say_flat
from aerokernels.files.writing import replacing
from aerokernels.flow import CellDensity, DensityField
from aerokernels.jobs.page import Panel, fitted_panel, house_style, panelled_figure
from aerokernels.medium import Body, SolidBody

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure

SPEED_OF_LIGHT = 299_792_458.0  # [m/s]
BODY_COLOUR, RAY_COLOUR, ACCENT, MUTED = "#5b6470", "#0b6e99", "#c2410c", "#8a94a0"
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
RASTER_CELLS = 400  # cells along each side of the density figure of an unstructured mesh
SQUARE = 3.6  # side of the panels of two-panel pictures [in]


def _colour_bar(figure: "Figure", mappable: Any, bar_axes: "Axes | None", label: str) -> "Colorbar":
    bar = figure.colorbar(mappable, cax=bar_axes, label=label)
    bar.outline.set_visible(False)
    return bar


def _powers_of_ten(axis: "Axis") -> None:
    """Label the decades of an axis with Unicode superscripts: Matplotlib's formula parser takes as long as a figure."""
    from matplotlib.ticker import FuncFormatter, NullLocator

    axis.set_major_formatter(FuncFormatter(lambda value, _: "10" + f"{np.log10(value):.0f}".translate(RAISED)))
    axis.set_minor_locator(NullLocator())


def _title(axes: "Axes", text: str) -> None:
    axes.set_title(text, y=1.0)  # without a given position Matplotlib measures all labels to place the title


def axes_of(dataset: "xarray.Dataset") -> tuple[str, str]:
    """Return the names of the pupil's axes: x and y, unless the pupil is turned."""
    first, second = dataset.attrs["pupil_axes"]
    return str(first), str(second)


def _draw_body(axes: "Axes", dataset: "xarray.Dataset") -> None:
    lines = []
    if "body_triangle" in dataset:
        from aerokernels.medium.bodies.solid_body import outlines

        lines = outlines(dataset["body_point"].values, dataset["body_triangle"].values.astype(np.int64))
    elif "body_z" in dataset:
        y, z = dataset["body_y"].values, dataset["body_z"].values
        if dataset.attrs.get("geometry") == "axisymmetric":  # one outline for both halves avoids a seam on the axis
            z, y = np.concatenate([z, z[::-1]]), np.concatenate([y, -y[::-1]])
        lines = [np.stack([y, z], axis=1)]
    for line in lines:
        axes.fill(1e3 * line[:, 1], 1e3 * line[:, 0], facecolor=BODY_COLOUR, linewidth=0.0, zorder=3)


def _draw_density(axes: "Axes", dataset: "xarray.Dataset") -> Any:
    from matplotlib import colormaps

    z, y = 1e3 * dataset["density_z"].values, 1e3 * dataset["density_y"].values
    density = dataset["density"].values
    low, high = float(density.min()), float(density.max())
    if is_flat(density):  # show uniform air far from the ends of the scale
        low, high = 0.9 * low, 1.1 * high
    ambient = (float(dataset.attrs.get("ambient_density", density.flat[-1])) - low) / (high - low)
    axes.set_facecolor(colormaps["viridis"](min(max(ambient, 0.0), 1.0)))  # the free stream goes on beyond the mesh
    mesh = None
    for side in (1.0, -1.0) if dataset.attrs.get("geometry") == "axisymmetric" else (1.0,):
        mesh = axes.pcolormesh(z, side * y, density, cmap="viridis", vmin=low, vmax=high, shading="flat")
    return mesh


def density_figure(dataset: "xarray.Dataset") -> "Figure":
    """Draw the density of the whole flow in the plane x = 0, with the body and the rays."""
    z, y = 1e3 * dataset["density_z"].values, 1e3 * dataset["density_y"].values
    low, high, top = z.min(), z.max() + 0.12 * np.ptp(z), y.max() + 0.05 * np.ptp(y)
    bottom = -top if dataset.attrs.get("geometry") == "axisymmetric" else y.min() - 0.05 * np.ptp(y)
    figure, [(axes, bar_axes)] = panelled_figure(fitted_panel((top - bottom) / (high - low), 6.6, 4.6, bar=True))
    mesh = _draw_density(axes, dataset)
    _draw_body(axes, dataset)
    if "ray_position" in dataset:
        position = 1e3 * dataset["ray_position"].values  # (ray, plane, axis)
        axes.plot(position[..., 2].T, position[..., 1].T, color="white", linewidth=0.7, alpha=0.9, zorder=4)
    axes.set(xlim=(low, high), ylim=(bottom, top), aspect="equal")
    axes.set(xlabel="z, optical axis looking forward [mm]", ylabel="y [mm]")
    _title(axes, "Density of the flow")
    _colour_bar(figure, mesh, bar_axes, "density [kg/m³]")
    return figure


def rays_figure(dataset: "xarray.Dataset") -> "Figure":
    """Draw the fan of rays in the flow, and the displacement of each ray from its straight line."""
    from matplotlib import colormaps

    position = 1e3 * dataset["ray_position"].values  # (ray, plane, axis)
    z, y = position[..., 2], position[..., 1]
    half = 1.6 * max(np.nanmax(np.abs(y[:, 0])), 1.0)
    start, nose = float(np.nanmin(z)), float(dataset.attrs.get("flow_front_m", 0.0)) * 1e3
    low, high = start - 0.15 * half, max(nose, start + half) + 0.35 * half
    shown = fitted_panel(2.0 * half / (high - low), 4.2, SQUARE, bar=True)
    figure, [(near, bar_axes), (stray, _)] = panelled_figure(shown, Panel(4.4, shown.height))
    mesh = _draw_density(near, dataset)
    _draw_body(near, dataset)
    near.plot(z.T, y.T, color="white", linewidth=0.9, zorder=4)
    near.set(xlim=(low, high), ylim=(-half, half), aspect="equal")
    near.set(xlabel="z [mm]", ylabel="y [mm]")
    _title(near, "Rays in the flow")
    _colour_bar(figure, mesh, bar_axes, "density [kg/m³]")

    deviation = 1e6 * dataset["ray_deviation"].values  # (ray, plane)
    _title(stray, "Displacement from the straight line (red: upper rays)")
    if is_flat([0.0, *dataset["ray_deviation"].values.ravel()], "m"):
        say_flat(stray, "straight: the displacement is below rounding")
        return figure
    start_y = dataset["ray_position"].values[:, 0, 1]
    scale = max(np.nanmax(np.abs(start_y)), 1e-12)
    for y0, along, off in zip(start_y, z, deviation, strict=True):
        stray.plot(along, off, color=colormaps["coolwarm"](0.5 + 0.5 * y0 / scale), linewidth=1.1)
    stray.axhline(0.0, color=MUTED, linewidth=0.6)
    stray.grid(True, color="#e3e7eb")
    stray.set(xlabel="z [mm]", ylabel=f"along {axes_of(dataset)[1]} [µm]")
    return figure


def opd_figure(dataset: "xarray.Dataset") -> "Figure":
    """Draw the optical path difference over the pupil: piston removed, and tilt and focus removed as well."""
    square = Panel(SQUARE, SQUARE, bar=True)
    figure, panels = panelled_figure(square, square)
    shown = {"opd": "No piston", "opd_without_focus": "No piston, tilt, focus"}
    for (axes, bar_axes), (name, title) in zip(panels, shown.items(), strict=True):
        opd = 1e9 * dataset[name].values
        x, y = 1e3 * dataset["pupil_x"].values, 1e3 * dataset["pupil_y"].values
        rms = Quantity(dataset[name].attrs["rms_m"], dataset[name].attrs["rms_error_m"], "m")
        if is_flat(dataset[name].values, "m", rms.error or 0.0):
            _title(axes, title)
            say_flat(axes, bar=bar_axes)
            continue
        limit = float(np.nanmax(np.abs(opd)))
        image = axes.imshow(
            opd,
            origin="lower",
            extent=extent_of(x, y),
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            interpolation="nearest",  # show the samples unchanged
        )
        across, up = axes_of(dataset)
        axes.set(xlabel=f"{across} [mm]", ylabel=f"{up} [mm]")
        _title(axes, f"{title}: {rms.scaled(1e9, 'nm')} rms")
        _colour_bar(figure, image, bar_axes, "OPD [nm]")
    return figure


def point_spread_figure(dataset: "xarray.Dataset") -> "Figure":
    """Draw the point spread function relative to the undisturbed peak, and cuts through it and the undisturbed one."""
    from matplotlib.colors import LogNorm

    figure, [(spot, bar_axes), (cut, _)] = panelled_figure(Panel(SQUARE, SQUARE, bar=True), Panel(SQUARE, SQUARE))
    angle_x, angle_y = 1e6 * dataset["angle_x"].values, 1e6 * dataset["angle_y"].values
    spread, perfect = dataset["point_spread"].values, dataset["point_spread_perfect"].values
    extent = extent_of(angle_x, angle_y)
    image = spot.imshow(
        np.maximum(spread, 1e-6),
        origin="lower",
        extent=extent,
        cmap="magma",
        norm=LogNorm(1e-4, 1.0),
        interpolation="nearest",
    )
    across, up = axes_of(dataset)
    spot.set(xlabel=f"angle toward {across} [µrad]", ylabel=f"angle toward {up} [µrad]")
    _title(spot, "Point spread function")
    _powers_of_ten(_colour_bar(figure, image, bar_axes, "intensity / undisturbed peak").ax.yaxis)
    middle = spread.shape[0] // 2, spread.shape[1] // 2
    cut.plot(angle_x, perfect[middle[0]], color=MUTED, linestyle="--", linewidth=1.2, label="undisturbed")
    cut.plot(angle_x, spread[middle[0]], color=RAY_COLOUR, linewidth=1.6, label=f"along {across}")
    cut.plot(angle_y, spread[:, middle[1]], color=ACCENT, linewidth=1.2, linestyle=":", label=f"along {up}")
    ratio = dataset.attrs.get("strehl")
    title = "Cuts through the axis"
    if ratio is not None:
        title = f"Cuts, Strehl ratio {Quantity(ratio, dataset.attrs.get('strehl_error', float('nan')), is_ratio=True)}"
    cut.set(xlabel="angle [µrad]", ylabel="intensity / undisturbed peak", yscale="log", ylim=(1e-5, 2.0))
    _title(cut, title)
    _powers_of_ten(cut.yaxis)
    cut.grid(True, color="#e3e7eb")
    cut.legend()
    return figure


def echo_figure(dataset: "xarray.Dataset") -> "Figure":
    """Draw the received power, and the detector's voltage with the threshold and the reported range."""
    figure, [(axes, _)] = panelled_figure(Panel(6.9, 3.3, scale=True))
    time, power, voltage = (dataset[name].values for name in ("time", "echo_power", "echo_voltage"))
    clean = dataset["echo_voltage_clean"].values if "echo_voltage_clean" in dataset else voltage
    shown = _around_pulse(power, clean)
    nanoseconds = 1e9 * time[shown]
    if np.array_equal(clean, voltage):
        axes.plot(nanoseconds, voltage[shown], color=RAY_COLOUR, linewidth=1.8, label="detector voltage")
    else:
        axes.plot(nanoseconds, voltage[shown], color="#9ec5d8", linewidth=0.9, label="recorded voltage")
        axes.plot(nanoseconds, clean[shown], color=RAY_COLOUR, linewidth=1.8, label="without noise")
    axes.set(xlabel="time after the pulse's peak left [ns]", ylabel="voltage [V]")
    threshold = dataset.attrs.get("threshold_v")
    if threshold is not None and np.isfinite(threshold):
        axes.axhline(threshold, color=MUTED, linewidth=1.0, linestyle="--", label=f"threshold {threshold:.4g} V")
    for key, words, colour, line in (
        ("true_range_m", "target at", MUTED, ":"),
        ("range_m", "reported range", ACCENT, "-"),
    ):
        distance = dataset.attrs.get(key)
        if distance is not None and np.isfinite(distance):
            nanosecond = 2e9 * distance / SPEED_OF_LIGHT
            measured = Quantity(distance, dataset.attrs.get(f"{key}_error"), "m")
            axes.axvline(nanosecond, color=colour, linewidth=1.1, linestyle=line, label=f"{words} {measured}")
    second = axes.twinx()
    second.plot(nanoseconds, 1e6 * power[shown], color="#2f9e6e", linewidth=1.2, linestyle="-.", label="received power")
    # Keep the power's curve apart from the voltage's, with both zeros at the same height.
    (low, high), top = axes.get_ylim(), 1.25 * second.get_ylim()[1]
    second.set(ylabel="received power [µW]", ylim=(top * low / high if high > 0.0 else None, top))
    handles = [pair for part in (axes, second) for pair in zip(*part.get_legend_handles_labels(), strict=True)]
    axes.legend([handle for handle, _ in handles], [label for _, label in handles], loc="upper right", fontsize=9)
    axes.grid(True, color="#e3e7eb")
    _title(axes, "Laser echo")
    return figure


def _around_pulse(power: np.ndarray, voltage: np.ndarray) -> slice:
    """Return the samples of the pulse with an eighth of its width on each side; all samples if there is no pulse."""
    parts = [np.abs(signal) / max(np.abs(signal).max(), 1e-300) for signal in (power, voltage)]
    above = np.flatnonzero(np.maximum(*parts) > 1e-3)
    if above.size == 0:
        return slice(None)
    margin = max((above[-1] - above[0]) // 8, 2)
    return slice(max(above[0] - margin, 0), above[-1] + margin + 1)


# Caption of each figure of a run, the function that draws it, and the variables it needs: some are absent if a stage
# failed or the flow is an index field.
FIGURES: dict[str, tuple[str, "Callable[[xarray.Dataset], Figure]", set[str]]] = {
    "density": ("The air density around the body, with a fan of rays from the pupil.", density_figure, {"density"}),
    "rays": (
        "The fan of rays near the pupil, and the displacement of each ray by refraction.",
        rays_figure,
        {"density", "ray_position", "ray_deviation"},
    ),
    "opd": (
        "The wavefront of a distant point in the pupil's direction of view.",
        opd_figure,
        {"opd", "opd_without_focus"},
    ),
    "point-spread": (
        "The focus of this wavefront, tilt included.",
        point_spread_figure,
        {"point_spread", "point_spread_perfect"},
    ),
    "echo": ("The pulse that returns from the reflector.", echo_figure, {"time", "echo_power", "echo_voltage"}),
}


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


def variable(dims: str | tuple[str, ...], values: Any, units: str, long_name: str) -> tuple[Any, ...]:
    """Return a variable with its unit and meaning, as xarray.Dataset takes it."""
    return dims, values, {"units": units, "long_name": long_name}


def density_variables(flow: DensityField) -> dict[str, Any]:
    """Return a flow's density in the plane x = 0 as variables of a dataset."""
    density, y, z = density_cells(flow)
    corners = ("corner_i", "corner_j")
    return {
        "density": variable(("cell_i", "cell_j"), density, "kg m-3", "density, cell averages"),
        "density_y": variable(corners, y, "m", "y of the cells' corners"),
        "density_z": variable(corners, z, "m", "z of the cells' corners"),
    }


def body_variables(body: Body | SolidBody | None) -> dict[str, Any]:
    """Return a body's surface or outline as variables of a dataset."""
    if isinstance(body, SolidBody):
        words = "corners of its triangles, by the number of their point"
        return {
            "body_point": variable(("body_vertex", "axis"), body.vertices, "m", "points of the body's surface"),
            "body_triangle": variable(("body_face", "corner"), body.triangles, "1", words),
        }
    if body is None:
        return {}
    return {
        f"body_{name}": variable("body_vertex", body.profile[:, k], "m", f"{name} of the body's outline")
        for k, name in enumerate("yz")
    }


def save_flow_figure(flow: DensityField, place: Path) -> None:
    """Write a picture of a flow's density to a file, whose name's extension determines the format."""
    import xarray

    attributes = {"geometry": flow.geometry, "ambient_density": flow.ambient_density}
    figure = density_figure(xarray.Dataset(density_variables(flow) | body_variables(flow.body), attrs=attributes))
    if place.suffix[1:].lower() not in figure.canvas.get_supported_filetypes():
        raise ValueError(f"{place}: {place.suffix!r} is not a picture format: use .png, .pdf or .svg")
    place.parent.mkdir(parents=True, exist_ok=True)
    with replacing(place) as (draft,), house_style():
        figure.savefig(draft)
