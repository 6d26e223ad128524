"""Make schlieren pictures, shadowgraphs and interferograms of a scene's flow, measure, compare and write them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from aerokernels import __version__, benches
from aerokernels.benches.fringes import Fringes
from aerokernels.benches.knife_edge import KnifeEdge
from aerokernels.benches.line_of_sight import check_exposure
from aerokernels.benches.picture import PictureView
from aerokernels.benches.shadowgraph import Screen
from aerokernels.display.canvas import ORANGE, house_style, png, styled_figure
from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import extent_of
from aerokernels.flow import DensityField, shipped_names
from aerokernels.jobs.store import SUMMARY_FILE, staged_folder, write_result, write_summary
from aerokernels.medium import IndexField
from aerokernels.prepare import flow_index
from aerokernels.scene import Scene, warn_of_unused
from aerokernels.scene.loading import SceneError, override, scene_error, shipped_scenes

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KINDS = ("schlieren", "shadowgraph", "interferogram")
DATASET_FILE, FIGURE_FILE, COMPARISON_FILE = "pictures.nc", "figure.png", "comparison.png"


@dataclass(frozen=True)
class PictureOptions:
    """Which pictures to make, and how; see `schlieren`, `shadowgraph` and `interferogram` for the options' meaning."""

    kinds: tuple[str, ...] = KINDS
    view: str | tuple[float, float, float] = "x"  # direction of the light
    extent: tuple[float, float, float, float] | None = None  # right from, to, up from, to [m]; None: the whole flow
    width: float | None = None  # length of the light's path through a planar flow [m]
    pixel_count: int = 256  # along the longer side
    rays_per_pixel: int = 1  # k of k x k rays a pixel
    spacing: float | None = None  # of the grid to which the flow is resampled [m]; None: half a pixel
    knife_edge: str | float = "vertical"
    cut_off: float = 0.5
    sensitivity: float | None = None  # change of light per deflection [1/rad]
    exposure: float = 1.0
    screen_distance: float = 0.5  # [m]
    source_angle: float = 0.0  # [rad]
    fringe_spacing: float | None = None  # [m]
    fringe_angle: float = 0.5 * math.pi  # [rad]
    shock_window: tuple[float, float] | None = None  # horizontal interval in which to measure the shock's angle [m]
    errors: bool = False  # whether to measure the error of each pixel's brightness, from five or six more pictures

    def __post_init__(self) -> None:
        """Check, before anything is read or traced."""
        unknown = [kind for kind in self.kinds if kind not in KINDS]
        if unknown or not self.kinds:
            raise ValueError(f"picture {', '.join(unknown) or 'none'} is not known: choose from {', '.join(KINDS)}")
        if self.spacing is not None and not self.spacing > 0.0:
            raise ValueError(f"spacing = {self.spacing}: give a positive length in metres")
        if self.pixel_count < 1 or self.rays_per_pixel < 1:
            raise ValueError(
                f"pixels = {self.pixel_count}, rays_per_pixel = {self.rays_per_pixel}: give whole numbers of at least 1"
            )
        if self.extent is not None and not (self.extent[0] < self.extent[1] and self.extent[2] < self.extent[3]):
            raise ValueError(f"extent {self.extent}: give right from, to, up from, to in metres, increasing")
        if self.shock_window is not None and not self.shock_window[0] < self.shock_window[1]:
            raise ValueError(f"shock window {self.shock_window}: give from and to in metres, increasing")
        KnifeEdge(self.knife_edge, self.cut_off, self.sensitivity)
        check_exposure(self.exposure)
        Screen(self.screen_distance, self.source_angle)
        Fringes(self.fringe_spacing, self.fringe_angle)
        if self.shock_window is not None and "schlieren" not in self.kinds:
            raise ValueError("the shock's angle is measured on the schlieren picture: request that kind too")


@dataclass(frozen=True, eq=False)
class BenchPictures:
    """Pictures of a scene's flow, and what was measured in them."""

    scene: Scene
    density: DensityField
    line_of_sight: benches.LineOfSight  # the rays that were traced
    pictures: Mapping[str, benches.SchlierenImage | benches.Shadowgraph | benches.Interferogram]  # by kind
    shock: benches.ShockAngle | None  # the outermost shock, if requested
    comparison: benches.HalfComparison | None  # with a photograph, if one was given
    measured_shock: benches.ShockAngle | None  # the photograph's shock
    errors: Mapping[str, np.ndarray]  # error of each pixel's brightness by kind, shape (ny, nx); NaN if not known

    @property
    def pixel_errors(self) -> dict[str, tuple[float, float] | None]:
        """Median and greatest error of a pixel's brightness by kind; None where that of a pixel is not known."""
        return {
            kind: None if np.isnan(error).any() else (float(np.median(error)), float(error.max()))
            for kind, error in self.errors.items()
        }

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The pictures' numbers, in SI units, as written to summary.json."""
        flow = self.density
        summary: dict[str, Any] = {
            "scene": self.scene.name,
            "mach": flow.mach,
            "ambient_density_kg_m3": flow.ambient_density,
            "wavelength_m": self.line_of_sight.wavelength,
            "pixel_size_m": list(self.line_of_sight.window.pitch),
            "rays_per_pixel": self.line_of_sight.rays_per_pixel,
            "kinds": list(self.pictures),
            "provenance": flow.provenance,
            "version": __version__,
        }
        for name, shock in (("shock", self.shock), ("measured_shock", self.measured_shock)):
            if shock is not None:
                summary |= {
                    f"{name}_angle_rad": shock.angle,
                    f"{name}_angle_standard_error_rad": shock.standard_error,
                    f"{name}_place_m": shock.place,
                }
        for kind, result in self.pixel_errors.items():
            median, greatest = result or (None, None)
            summary |= {f"{kind}_error_median": median, f"{kind}_error_greatest": greatest}
        if self.comparison is not None:
            summary |= {"correlation": self.comparison.correlation, "covered": self.comparison.covered}
        return summary

    def to_xarray(self) -> "xarray.Dataset":
        """Return all pictures, each under the name of its kind, and the traced data as one dataset with units."""
        import xarray

        merged = xarray.Dataset()
        attributes: dict[str, Any] = {}
        for kind, picture in self.pictures.items():
            one = picture.to_xarray()
            attributes |= {
                f"{kind}_{key}": value for key, value in one.attrs.items() if key not in ("kind", "right", "up")
            }
            if kind in self.errors:
                words = {"units": "1", "long_name": f"error of the brightness of the {kind}"}
                one[f"{kind}_error"] = (one["intensity"].dims, self.errors[kind], words)
            merged = merged.merge(one.rename(intensity=kind).drop_attrs(deep=False), compat="override")
        if self.comparison is not None:
            merged["comparison"] = self.comparison.to_xarray()["intensity"]
        window = self.line_of_sight.window
        merged.attrs = {
            "title": self.scene.title or self.scene.name,
            "source": f"aerokernels {__version__}",
            "wavelength_m": self.line_of_sight.wavelength,
            "right": window.right,
            "up": window.up,
            **attributes,
        }
        return merged


def picture_scene(place: str, settings: Mapping[str, Any]) -> Scene:
    """Load a scene by its file or name, or a shipped flow by its name with defaults for everything else."""
    if place in shipped_names():
        tables: dict[str, Any] = {"name": place, "flow": {"source": place}}
        override(tables, settings, place)
        try:
            return Scene.model_validate(tables)
        except ValidationError as fault:
            raise scene_error(fault, tables, place, dict(settings), Scene) from None
    if not Path(place).exists() and place not in shipped_scenes():
        raise SceneError(
            f"{place}: there is no such scene file; give a TOML file, a shipped scene ({', '.join(shipped_scenes())}) "
            f"or a shipped flow ({', '.join(shipped_names())})"
        )
    return Scene.load(place, settings)


def picture_field(density: DensityField, scene: Scene, options: PictureOptions) -> IndexField:
    """Return the refractive index of a scene's whole flow on a uniform grid."""
    if scene.grid.route != "uniform":
        raise ValueError("grid.route = 'mesh' is not for pictures, which resample the flow: use 'uniform'")
    mesh_field = flow_index(scene, density)
    spacing = options.spacing
    if spacing is None:
        low, high = mesh_field.box
        size = high - low
        extent = options.extent or (0.0, float(size[np.isfinite(size)].max()), 0.0, 0.0)
        spacing = max(extent[1] - extent[0], extent[3] - extent[2]) / options.pixel_count / 2.0
    return mesh_field.resample(spacing, interpolation=scene.grid.interpolation)


def make_pictures(
    scene: Scene,
    options: PictureOptions,
    *,
    measured: benches.Picture | None = None,
    progress: Callable[[str, float], None] = lambda stage, fraction: None,
) -> BenchPictures:
    """Make the pictures of a scene, of which [flow], [grid] interpolation and [trace] are used.

    `measured` is a schlieren photograph to compare with the simulated one. `progress` is called with the name of each
    stage and the share of the job done before it.
    """
    if measured is not None and "schlieren" not in options.kinds:
        raise ValueError("a measured picture is compared with the schlieren picture: request that kind too")
    warn_of_unused(scene, "schlieren")
    progress("reading and resampling the flow", 0.0)
    density = scene.density_field()
    field = picture_field(density, scene, options)
    progress("tracing the light", 0.3)
    traced = benches.line_of_sight(
        field,
        view=options.view,
        extent=options.extent,
        width=options.width,
        pixel_count=options.pixel_count,
        rays_per_pixel=options.rays_per_pixel,
        tolerance=scene.trace.tolerance,
        wavelength=scene.flow.wavelength,
        backend=scene.trace.backend,
        device=scene.trace.device,
        precision=scene.trace.precision,
    )
    progress("making the pictures", 0.8)
    pictures: dict[str, benches.SchlierenImage | benches.Shadowgraph | benches.Interferogram] = {}
    if "schlieren" in options.kinds:
        edge = {name: getattr(options, name) for name in ("knife_edge", "cut_off", "sensitivity", "exposure")}
        pictures["schlieren"] = benches.schlieren(traced, **edge)
    if "shadowgraph" in options.kinds:
        pictures["shadowgraph"] = benches.shadowgraph(
            traced, distance=options.screen_distance, source_angle=options.source_angle
        )
    if "interferogram" in options.kinds:
        pictures["interferogram"] = benches.interferogram(
            traced, fringe_spacing=options.fringe_spacing, fringe_angle=options.fringe_angle
        )
    shock = measured_shock = None
    if options.shock_window is not None:
        shock = benches.measure_shock_angle(pictures["schlieren"], options.shock_window, half="both", degree=2)
        if measured is not None:
            measured_shock = benches.measure_shock_angle(measured, options.shock_window, half="lower", degree=2)
    errors = {}
    for kind, picture in pictures.items() if options.errors else ():
        progress(f"measuring the error of the {kind}", 0.85)
        errors[kind] = picture.error
    comparison = None if measured is None else benches.compare_halves(pictures["schlieren"], measured)
    return BenchPictures(scene, density, traced, pictures, shock, comparison, measured_shock, errors)


def write_pictures(bench: BenchPictures, out: Path) -> list[str]:
    """Write pictures.nc, figure.png, a grey PNG of each kind and summary.json: all or none; return their names."""
    with staged_folder(out) as folder:
        for kind, picture in bench.pictures.items():
            benches.write_picture(folder / f"{kind}.png", picture)
        with house_style():
            (folder / FIGURE_FILE).write_bytes(png(pictures_figure(bench.pictures, bench.shock)))
            if bench.comparison is not None:
                (folder / COMPARISON_FILE).write_bytes(png(comparison_figure(bench.comparison)))
        write_result(folder / DATASET_FILE, bench.to_xarray())
        write_summary(folder / SUMMARY_FILE, bench.summary)
        return sorted(path.name for path in folder.iterdir())


def _axes(picture: PictureView, count: int) -> "tuple[Figure, list[Axes]]":
    width, height = (float(np.ptp(side)) for side in (picture.horizontal, picture.vertical))
    ratio = min(max(height / width, 0.3), 3.0)
    across = 4.2 if count > 1 else 6.4
    with styled_figure(across * count, across * ratio + 0.9) as figure:
        axes = figure.subplots(1, count, squeeze=False, sharey=True)[0]
    return figure, list(axes)


def _draw(axes: "Axes", picture: PictureView) -> None:
    extent = extent_of(1e3 * picture.horizontal, 1e3 * picture.vertical)
    axes.imshow(picture.intensity, origin="lower", extent=extent, cmap="gray", vmin=0.0, vmax=1.0, interpolation="none")
    axes.set_xlabel(_axis_label(getattr(picture, "right", None), "z"))


def _axis_label(direction: np.ndarray | None, default: str) -> str:
    """Return the label of a picture's axis: x, y or z where it points along one of them, else words."""
    if direction is None:
        return f"{default} [mm]"
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) < 1.0 - 1e-9:
        return "across the view [mm]"
    return f"{'-' if direction[axis] < 0.0 else ''}{'xyz'[axis]} [mm]"


def pictures_figure(pictures: Mapping[str, Any], shock: benches.ShockAngle | None = None) -> "Figure":
    """Draw pictures side by side by kind, and into the schlieren picture the shock that was measured on it."""
    figure, panels = _axes(next(iter(pictures.values())), len(pictures))
    for axes, (kind, picture) in zip(panels, pictures.items(), strict=True):
        _draw(axes, picture)
        axes.set_title(_title(kind, picture))
        if kind == "schlieren" and shock is not None:
            _draw_shock(axes, shock)
    panels[0].set_ylabel(_axis_label(next(iter(pictures.values())).up, "y"))
    return figure


def _draw_shock(axes: "Axes", shock: benches.ShockAngle) -> None:
    along = np.unique(shock.points[:, 0])
    height = np.polynomial.polynomial.polyval(along - shock.place, shock.curve)
    angle, error = np.degrees(shock.angle), 2.0 * np.degrees(shock.standard_error)
    label = f"shock {Quantity(float(angle), float(error))}° at {1e3 * shock.place:.1f} mm"
    for sign, words in ((1.0, label), (-1.0, None)):
        if (sign * shock.points[:, 1] > 0.0).any():
            axes.plot(1e3 * along, sign * 1e3 * height, color=ORANGE, linewidth=1.2, linestyle="--", label=words)
    axes.legend(loc="lower right", fontsize=8, labelcolor="white", frameon=True, facecolor="#1d2630", framealpha=0.8)


def comparison_figure(comparison: benches.HalfComparison) -> "Figure":
    """Draw the simulated picture above and the measured picture below."""
    figure, (axes,) = _axes(comparison, 1)
    _draw(axes, comparison)
    axes.axhline(0.0, color=ORANGE, linewidth=0.8)
    axes.set(ylabel="y [mm]", title=f"Above simulated, below measured: r = {comparison.correlation:.3f}")
    return figure


def _title(kind: str, picture: Any) -> str:
    if kind == "schlieren":
        edge = picture.knife_edge
        words = f"{edge} edge" if isinstance(edge, str) else f"edge that brightens toward {np.degrees(edge):.0f}°"
        return f"Schlieren, {words}"
    if kind == "shadowgraph":
        return f"Shadowgraph, screen at {picture.distance:g} m"
    spacing = picture.fringe_spacing
    return "Interferogram, infinite fringe" if spacing is None else f"Interferogram, fringes of {1e3 * spacing:g} mm"
