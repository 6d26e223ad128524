"""Pictures of a flow: its density in the plane x = 0 with body, pupil and rays, and how rays bend."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.canvas import color_bar, color_map, data_url, figure_of
from aerokernels.display.figures import Axis, Line, Lines, packed, plain
from aerokernels.display.shown import is_flat
from aerokernels.files.writing import replacing
from aerokernels.flow import CellDensity, DensityField
from aerokernels.jobs.pages.page import Panel
from aerokernels.jobs.store import variable
from aerokernels.medium import Body, SolidBody

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


def density_limits(density: np.ndarray) -> tuple[float, float]:
    """Return the ends of a density's color scale; those of uniform air are far from its value."""
    low, high = float(np.nanmin(density)), float(np.nanmax(density))
    return (0.9 * low, 1.1 * high) if is_flat(density) else (low, high)


RASTER_CELLS = 400  # cells along each side of the density of an unstructured mesh
RASTER = 220  # pixels along a side of a flow without a structured mesh, as the page's script holds it


@dataclass(frozen=True)
class View:
    """A part of the plane: its middle and height [mm], and height over width."""

    z: float
    y: float
    span: float
    shape: float


@dataclass(frozen=True, eq=False)
class Air:
    """The density of a run's dataset, for pictures in mm."""

    dataset: "xarray.Dataset"

    @cached_property
    def mirror(self) -> bool:
        """Whether the plane's lower half is the mirror image of the upper."""
        return bool(self.dataset.attrs.get("geometry") == "axisymmetric")

    @cached_property
    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates z and y of the cells' corners."""
        return 1e3 * self.dataset["density_z"].values, 1e3 * self.dataset["density_y"].values

    @cached_property
    def bodies(self) -> list[np.ndarray]:
        """Outlines of the body, each of shape (point_count, 2) with z and y."""
        data = self.dataset
        if "body_triangle" in data:
            from aerokernels.medium.bodies.solid_body import outlines

            lines = outlines(data["body_point"].values, data["body_triangle"].values.astype(np.int64))
            return [1e3 * line[:, ::-1] for line in lines]
        if "body_z" not in data:
            return []
        z, y = 1e3 * data["body_z"].values, 1e3 * data["body_y"].values
        if self.mirror:
            z, y = np.concatenate([z, z[::-1]]), np.concatenate([y, -y[::-1]])
        return [np.stack([z, y], axis=1)]

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Ends of the mesh: z from, to, y from, to."""
        z, y = self.corners
        low = -float(y.max()) if self.mirror else float(y.min())
        return float(z.min()), float(z.max()), low, float(y.max())

    @cached_property
    def whole(self) -> View:
        """The view of the whole flow."""
        left, right, low, high = self.box
        width, height = 1.16 * (right - left), 1.08 * (high - low)
        shape = min(max(height / width, 0.35), 1.1)
        return View(0.5 * (left + right) + 0.04 * width, 0.5 * (low + high), max(height, width * shape), shape)

    @cached_property
    def near(self) -> View | None:
        """The view of the rays; None without any."""
        if "ray_position" not in self.dataset:
            return None
        ray = 1e3 * self.dataset["ray_position"].values
        half = 1.7 * max(float(np.nanmax(np.abs(ray[:, 0, 1] - np.nanmean(ray[:, 0, 1])))), 1.0)
        start, front = float(np.nanmin(ray[..., 2])), 1e3 * float(self.dataset.attrs.get("flow_front_m", 0.0))
        low, high = start - 0.15 * half, max(front, start + half) + 0.35 * half
        height, width = 2.0 * half, high - low
        shape = min(max(height / width, 0.5), 1.04)
        return View(0.5 * (low + high), float(np.nanmean(ray[:, 0, 1])), max(height, width * shape), shape)

    def plot(self) -> dict[str, Any]:
        """Return all views for the page's script; the pointer says n - 1 too, if the run holds it per kg/m3."""
        data, (z, y) = self.dataset, self.corners
        low, high = density_limits(data["density"].values)
        air: dict[str, Any] = {
            "limits": [low, high],
            "mirror": self.mirror,
            "k": self.dataset.attrs.get("index_per_density"),
            "arrow": True,
        }
        air["ambient"] = float(data.attrs.get("ambient_density", data["density"].values.flat[-1]))
        if _is_regular(z, y):
            step = [max(1, size // RASTER) for size in data["density"].shape]
            values = data["density"].values[:: step[0], :: step[1]]
            air["raster"] = packed(values)
            air |= {"y0": float(y[0, 0]), "dy": float(np.ptp(y)) / values.shape[0]}
            air |= {"z0": float(z[0, 0]), "dz": float(np.ptp(z)) / values.shape[1]}
        else:
            air |= {"z": packed(z), "y": packed(y), "rho": packed(data["density"].values), "openEnd": True}
        air["bodies"] = [plain(one) for one in self.bodies]
        air["reach"] = 1.3 * self.whole.span
        if "ray_position" in data:
            ray, stray = 1e3 * data["ray_position"].values, 1e9 * data["ray_deviation"].values
            rows = zip(ray, stray, strict=True)
            air["rays"] = [{"z": plain(r[:, 2]), "y": plain(r[:, 1]), "stray": plain(s, 4)} for r, s in rows]
            first, last = ray[0, 0], ray[-1, 0]
            air["pupil"] = [[float(first[2]), float(first[1])], [float(last[2]), float(last[1])]]
        views = [("density", self.whole), ("rays", self.near)]
        shown = [{"id": name, "view": vars(view)} for name, view in views if view is not None]
        return {"kind": "air", "air": air, "views": shown}

    def panels(self) -> list[Panel]:
        """Return the panels: the whole flow, the flow near the rays, and the bending of the rays."""
        caption = "Cells of the flow's mesh" + (", mirrored below the axis" if self.mirror else "") + "."
        zoom = "Drag to move; Ctrl and wheel, two fingers, or + and − to zoom."
        says = "Density around the body." + (" The frame marks the part beside it." if self.near else "")
        alt = "Density of the air in the plane of the optical axis, with the body."
        panels = [Panel("density", "The flow", says, alt, AirView(self, self.whole, False), caption)]
        if self.near is not None:
            says = "They leave the pupil and cross the flow."
            alt = "Density near the pupil, with rays along the direction of view."
            panels.append(
                Panel("rays", "Rays through the flow", says, alt, AirView(self, self.near, True), zoom, tools="air")
            )
            panels.append(self._bending())
        return panels

    def _bending(self) -> Panel:
        data = self.dataset
        stray, place = 1e9 * data["ray_deviation"].values, 1e3 * data["ray_position"].values
        title, second = "Bending of the rays", str(data.attrs["pupil_axes"][1])
        if is_flat([0.0, *data["ray_deviation"].values.ravel()], "m"):
            return Panel("bending", title, "The rays are straight: their displacement is below rounding.")
        middle = float(np.nanmean(place[:, 0, 1]))
        lines = [
            Line(
                ray[:, 2],
                off,
                f"start {'above' if ray[0, 1] > middle else 'below'} the center" if ray[0, 1] != middle else "",
                "twosolid" if ray[0, 1] > middle else "one" if ray[0, 1] < middle else "plain",
                says=f"Ray from y = {ray[0, 1]:.2f} mm",
            )
            for ray, off in zip(place, stray, strict=True)
        ]
        y = Axis(f"displacement along {second} [nm]", unit="nm")
        shown = Lines(
            Axis("z [mm]", (float(np.nanmin(place[..., 2])), float(np.nanmax(place[..., 2]))), "mm"), y, lines
        )
        most = float(np.nanmax(np.abs(stray)))
        return Panel(
            "bending",
            title,
            f"Distance of each ray from its straight line, at most {_length(most)}.",
            "Displacement of the rays against z.",
            Lines(shown.x, shown.y, lines, pick=True),
            "Bending by gradients of the air; body and windows do not refract here.",
        )


@dataclass(frozen=True, eq=False)
class AirView:
    """One view of the density; its data for the script are in `Air.plot`."""

    air: Air
    view: View
    with_rays: bool

    def spec(self, name: str) -> dict[str, Any]:
        """Return nothing: `Air.plot` describes all views."""
        return {}

    def static(self) -> str:
        """Return the view for paper, as a data URL."""
        with self.figure() as figure:
            return data_url(figure, "png")

    @contextmanager
    def figure(self) -> "Iterator[Figure]":
        """Yield the view as a Matplotlib figure."""
        data, view, (z, y) = self.air.dataset, self.view, self.air.corners
        density = data["density"].values
        low, high = density_limits(density)
        colors = color_map("density")
        with figure_of(min(2.5, 0.65 + 2.0 * view.shape), bar=True) as (figure, axes):
            ambient = (float(data.attrs.get("ambient_density", density.flat[-1])) - low) / (high - low)
            axes.set_facecolor(colors(min(max(ambient, 0.0), 1.0)))  # the free stream goes on beyond the mesh
            mesh = None
            for side in (1.0, -1.0) if self.air.mirror else (1.0,):
                mesh = axes.pcolormesh(z, side * y, density, cmap=colors, vmin=low, vmax=high, rasterized=True)
            for line in self.air.bodies:
                axes.fill(line[:, 0], line[:, 1], facecolor="#6d7580", lw=0.0, zorder=3)
            if self.with_rays:
                ray = 1e3 * data["ray_position"].values
                axes.plot(ray[..., 2].T, ray[..., 1].T, color="white", lw=0.7, zorder=4)
            half = 0.5 * view.span
            axes.set(xlim=(view.z - half / view.shape, view.z + half / view.shape), aspect="equal")
            axes.set(ylim=(view.y - half, view.y + half), xlabel="z [mm], optical axis, forward →", ylabel="y [mm]")
            color_bar(figure, mesh, "density [kg/m³]")
            yield figure


def _is_regular(z: np.ndarray, y: np.ndarray) -> bool:
    """Return whether the cells' corners are a raster: rows along z, columns along y, all of the same size."""
    straight = np.ptp(z, axis=0).max() == 0.0 and np.ptp(y, axis=1).max() == 0.0
    if not straight:
        return False
    steps = np.diff(z[0]), np.diff(y[:, 0])
    return all(np.allclose(one, one[0], rtol=1e-6) and one[0] > 0.0 for one in steps)


def _length(nanometres: float) -> str:
    return f"{nanometres:.3g} nm" if nanometres < 1e3 else f"{1e-3 * nanometres:.3g} µm"


def density_cells(field: DensityField) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the density of cells (i, j) [kg/m3] in the plane of `plane_of`, and y and z of their corners [m]."""
    if isinstance(field, CellDensity) and field.mesh.shape is not None:
        shape = field.mesh.shape
        corners = field.mesh.vertices.reshape(*shape, 2)
        return field.density.reshape(shape[0] - 1, shape[1] - 1), corners[..., 0], corners[..., 1]
    low, high = (corner[-2:] for corner in field.box)
    axes = [np.linspace(low[k], high[k], RASTER_CELLS + 1) for k in range(2)]
    middle = np.meshgrid(*(0.5 * (axis[1:] + axis[:-1]) for axis in axes), indexing="ij")
    y, z = (axis.ravel() for axis in middle)
    density = field.density_at(np.stack([np.full(y.size, plane_of(field)), y, z], axis=1))
    density = np.where(np.isnan(density), field.ambient_density, density)  # inside the body, which is drawn on top
    corner_y, corner_z = np.meshgrid(*axes, indexing="ij")
    return density.reshape(RASTER_CELLS, RASTER_CELLS), corner_y, corner_z


def plane_of(field: DensityField) -> float:
    """Return the x of the plane in which a flow is shown [m]: 0, or the middle of a volume that is beside it."""
    low, high = (float(corner[0]) if len(corner) == 3 else 0.0 for corner in field.box)
    return 0.0 if low <= 0.0 <= high else 0.5 * (low + high)


def density_variables(flow: DensityField) -> dict[str, Any]:
    """Return a flow's density in the plane of `plane_of` as variables of a dataset."""
    density, y, z = density_cells(flow)
    corners = ("corner_i", "corner_j")
    return {
        "density": variable(
            ("cell_i", "cell_j"), density, "kg m-3", f"density, cell averages, at x = {plane_of(flow):g} m"
        ),
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
    air = Air(xarray.Dataset(density_variables(flow) | body_variables(flow.body), attrs=attributes))
    with AirView(air, air.whole, with_rays=False).figure() as figure:
        if place.suffix[1:].lower() not in figure.canvas.get_supported_filetypes():
            raise ValueError(f"{place}: {place.suffix!r} is not a picture format: use .png, .pdf or .svg")
        place.parent.mkdir(parents=True, exist_ok=True)
        with replacing(place) as (draft,):
            figure.savefig(draft)
