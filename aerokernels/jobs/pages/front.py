"""Pictures of a wavefront: its map, cuts, the image of a point, and of what it is made."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.figures import LEAST_DECADE, Axis, Line, Lines, Raster, packed, plain
from aerokernels.display.quantities import Quantity
from aerokernels.jobs.pages.page import Bar, Panel, shown
from aerokernels.jobs.store import number_or_nan

if TYPE_CHECKING:
    import xarray

# Kinds of aberration, and Noll's indices of their Zernike polynomials.
GROUPS = {
    "tilt": (2, 3),
    "focus": (4,),
    "astigmatism": (5, 6),
    "coma": (7, 8),
    "trefoil": (9, 10),
    "spherical": (11,),
}


@dataclass(frozen=True, eq=False)
class Front:
    """The wavefront of a run's dataset, in mm, nm and microradian.

    Attributes:
        dataset: The dataset, with "opd", "opd_error", "zernike" and "point_spread".
        error: Error of the OPD's rms [m]; NaN if not known.
    """

    dataset: "xarray.Dataset"
    error: float

    @cached_property
    def sizes(self) -> dict[str, Quantity]:
        """Rms of each kind of aberration [m], by the keys of GROUPS, and "else".

        A vector's length changes by at most the length of the vector of its components' errors.
        """
        terms = self.dataset["zernike"]
        value, error = terms.values, self.dataset["zernike_error"].values
        sizes = {}
        for name, indices in GROUPS.items():
            some = np.array(indices) - 1
            sizes[name] = Quantity(float(np.linalg.norm(value[some])), float(np.linalg.norm(error[some])))
        rest, off = (number_or_nan(terms.attrs.get(f"rest_rms{name}_m")) for name in ("", "_error"))
        return {**sizes, "else": Quantity(rest, off)}

    @cached_property
    def axes(self) -> tuple[str, str]:
        """Names of the pupil's axes."""
        first, second = self.dataset.attrs["pupil_axes"]
        return str(first), str(second)

    @cached_property
    def axis(self) -> np.ndarray:
        """Centers of the pixels [mm]."""
        return 1e3 * self.dataset["pupil_x"].values

    @cached_property
    def span(self) -> tuple[float, float]:
        """Ends of the outer pixels [mm]."""
        half = 0.5 * float(self.axis[1] - self.axis[0])
        return float(self.axis[0]) - half, float(self.axis[-1]) + half

    @property
    def grey(self) -> float:
        """Below this the OPD is below its error [nm]; 0 if the error is not known."""
        return 1e9 * self.error if math.isfinite(self.error) else 0.0

    @property
    def radius(self) -> float:
        """Distance of the farthest pixel from the center [mm]."""
        known = np.isfinite(self.dataset["opd"].values)
        return float(np.hypot(self.axis[None, :], self.axis[:, None])[known].max())

    def plot(self) -> dict[str, Any]:
        """Return the wavefront for the page's script."""
        data, wave = self.dataset, 1e9 * float(self.dataset["wavelength"])
        spot = wave / (2.0 * self.radius)
        return {
            "kind": "wavefront",
            "opd": packed(1e9 * data["opd"].values),
            "errors": packed(1e9 * data["opd_error"].values),
            **{
                name: packed(data[f"pupil_{name}"].values)
                for name in ("weight", "intensity")
                if f"pupil_{name}" in data
            },
            "axis": plain(self.axis),
            "axes": list(self.axes),
            "radius": self.radius,
            "error": self.grey,
            "wave": wave,
            "angles": [3.0 * spot, 8.0 * spot],
            "groups": {name: list(indices) for name, indices in GROUPS.items()},
        }

    def panels(self) -> list[Panel]:
        """Return the panels: kinds of aberration, map, cuts, image of a point and its cuts."""
        across, up = self.axes
        error = f"{self.grey:.2g} nm" if self.grey else "not known"
        return [
            self._kinds(),
            Panel(
                "opd",
                "Optical path difference",
                "What the flow adds to the light's path. Orange is delayed.",
                "Map of the optical path difference over the pupil, piston removed.",
                _Part(self.map("opd")),
                "A distant point ahead, seen through the flow. Grey: below the error, shown once little is left.",
                tools="terms",
                again=lambda: self.map("opd_without_focus").static(),
            ),
            Panel(
                "cuts",
                "Cuts through the map",
                f"Along {across} and {up} through the center, with the same terms removed.",
                "Optical path difference along both axes.",
                _Part(self._cuts()),
                f"Grey band: below the error of the OPD, {error}.",
            ),
            Panel(
                "psf",
                "Image of a point",
                "Image of a distant point, tilt included.",
                "Point spread function over angle.",
                _Part(self._spot()),
                "",
                tools="scale",
            ),
            Panel(
                "psfcuts",
                "Cuts through the image",
                "Against the image without flow.",
                "Point spread function along both axes, and without flow.",
                _Part(self._spot_cuts()),
            ),
        ]

    def _kinds(self) -> Panel:
        most = max(*(one.value for one in self.sizes.values()), 1e-15)
        names = {"else": "All else", **{name: name.capitalize() for name in GROUPS}}
        rows = []
        for name, size in self.sizes.items():
            error = size.error or 0.0
            text = shown(size, 1e9, "nm") if size.value >= error else f"≤ {1e9 * (size.value + error):.2g} nm"
            kind = "below" if size.value < error else ""
            rows.append(Bar(names[name], text, 100.0 * size.value / most, kind=kind))
        says, grey = "Rms of each kind of aberration, by Zernike polynomials.", "Grey rows are below their error."
        return Panel("parts", "What the wavefront is made of", says, rows=rows, caption=grey)

    def map(self, name: str) -> Raster:
        """Return the picture of a map of the dataset."""
        values = 1e9 * self.dataset[name].values
        most = float(np.nanmax(np.abs(values))) or 1.0
        across, up = (Axis(f"{one} [mm]", self.span, "mm") for one in self.axes)
        rms = float(np.sqrt(np.nanmean(values**2)))
        label = "OPD [nm], + is delayed" if name == "opd" else "without tilt and focus [nm]"
        return Raster(
            across,
            up,
            values[None],
            Axis(label, (-most, most), "nm"),
            "delay",
            self.grey if rms < 3.0 * self.grey else 0.0,
        )

    def _cuts(self) -> Lines:
        values, middle = 1e9 * self.dataset["opd"].values, self.axis.size // 2
        across, up = self.axes
        lines = [
            Line(self.axis, values[middle], f"along {across}", "one"),
            Line(self.axis, values[:, middle], f"along {up}", "two"),
        ]
        return Lines(
            Axis(f"{across} or {up} [mm]", self.span, "mm"), Axis("OPD [nm]", unit="nm"), lines, band=self.grey
        )

    def _spot(self) -> Raster:
        angle = 1e6 * self.dataset["angle_x"].values
        across, up = (Axis(f"angle toward {one} [µrad]", (float(angle[0]), float(angle[-1]))) for one in self.axes)
        scale = Axis("over the undisturbed peak", (math.log10(LEAST_DECADE), 0.0), log=True)
        return Raster(across, up, self.dataset["point_spread"].values[None], scale, "light")

    def _spot_cuts(self) -> Lines:
        data, angle = self.dataset, 1e6 * self.dataset["angle_x"].values
        spread, perfect = data["point_spread"].values, data["point_spread_perfect"].values
        middle = angle.size // 2
        lines = [
            Line(angle, perfect[middle], "without flow", "plain"),
            Line(angle, spread[middle], f"along {self.axes[0]}", "one"),
            Line(angle, spread[:, middle], f"along {self.axes[1]}", "two"),
        ]
        y = Axis("over the undisturbed peak", (LEAST_DECADE, 2.0), log=True)
        return Lines(Axis("angle [µrad]", (float(angle[0]), float(angle[-1])), "µrad"), y, lines)


@dataclass(frozen=True, eq=False)
class _Part:
    """A picture whose data for the script are in `Front.plot`."""

    picture: Lines | Raster

    def spec(self, name: str) -> dict[str, Any]:
        return {}

    def static(self) -> str:
        return self.picture.static()
