"""A wavefront over a pupil: its numbers with their errors, its image, and its export to other packages."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..derived import key_of
from ..display.quantities import ErrorBudget, Quantity
from ..display.shown import drawn_on, is_flat, map_picture, say_flat, shown
from ..inputs.arguments import checked
from ..inputs.checks import check_count, check_positive, check_share, check_wavelength
from ..inputs.kinds import refuse_masked, wrong_kind
from ..process.clock import clocked, stage
from ..pupils import Projected, Pupil, seen_along
from ..tracing.variants.causes import Variants
from .arithmetic import compare, divided, minus, plus, times
from .changes import Changes, changes_of, of_each_pixel, of_extremes, of_opd, of_samples, without_named
from .exports import SIGN_CONVENTION, from_xarray, to_hcipy, to_poppy, to_prysm, to_xarray, to_zemax
from .files import read, to_fits
from .modes import centroid, structure_function, zernike, zernike_errors, zernike_table
from .point_spread import psf
from .scattered import from_samples
from .terms import check_metres, check_terms, fit_tilt, mean_phasor, weighted_mean
from .transfer import encircled_energy, fwhm, image_quantities, mtf, otf

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@shown
@checked
@dataclass(frozen=True, eq=False, repr=False)
class Wavefront:
    """A wavefront over a pupil, sampled at the centres of square pixels, and how it was obtained.

    Angles are those of the beam that leaves the pupil along the look direction: OPD = a x, light delayed at +x, turns
    the beam by +a toward +x, and the peak of `psf` is at +a. A distant point seen through the same air appears at -a.
    All are angles in vacuum: in an ambient medium of index n the beam is turned by a / n.

    `a + b`, `a - b` (over one pupil, at one wavelength), `2 * a`, `a / 2` and `-a` are wavefronts too, of the OPDs'
    sum, difference and so on, with errors: see arithmetic.py.

    Attributes:
        opd: Optical path difference [m], positive where light is delayed, shape (n, n), axes [y, x]: rows along the
            pupil's second axis, columns along its first, both ascending, or along those of a pupil that faces along
            `direction`; NaN where `weight` is 0.
        weight: Amplitude transmission of each pixel, averaged over its area, shape (n, n).
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        intensity: Mean intensity in each pixel, shape (n, n). It exceeds `weight` squared where an edge or an
            apodisation crosses a pixel; None takes `weight` squared.
        radius: Radius of the unit disc of the Zernike polynomials [m]; None takes half of the map's width.
        pupil: The pupil, if the map belongs to one.
        direction: Direction in which the rays left the pupil, shape (3,); None means the pupil's normal.
        blocked: Share of the pupil's weight whose rays did not arrive behind the field.
        removed: Names of the terms that were removed.
        plan: How the rays were traced, if they were.
        seconds: Wall time by stage: see STAGES in clock.py.
        varied: Function that returns some of the rays, which are pixels, and how they change by each cause of an error
            (tracing/variants/causes.py), or None; the errors of all numbers follow from it.
        budget: Function that returns the error budget of the OPD [m], where no rays are known.
        error_map: Error of the OPD of each pixel [m], where no rays are known, shape (n, n); None takes the budget's
            total for all. The errors of all numbers follow from it.

    Raises:
        TypeError: An argument of the wrong type.
        ValueError: Shapes disagree, the pixel is not positive, the pupil is empty, the OPD inside the pupil is not
            finite, a weight or an error is negative, or the wavelength is outside 0.1 to 24 um.
    """

    opd: np.ndarray
    weight: np.ndarray
    pixel: float
    wavelength: float
    intensity: np.ndarray | None = None
    radius: float | None = None
    pupil: Pupil | None = None
    direction: np.ndarray | None = None
    blocked: float = 0.0
    removed: tuple[str, ...] = ()
    plan: Any = None
    seconds: dict[str, float] = field(default_factory=dict)
    varied: Callable[[], Variants | None] | None = None
    budget: Callable[[], ErrorBudget] | None = None
    error_map: np.ndarray | None = None

    @property
    def key(self) -> Hashable:
        """A key for caches that is equal for equal maps, however long they took."""
        return key_of(
            [getattr(self, each.name) for each in fields(self) if each.name not in ("seconds", "varied", "budget")]
        )

    def __post_init__(self):
        """Check the values and store read-only copies."""
        if not (self.pupil is None or isinstance(self.pupil, Pupil)):
            raise wrong_kind(self.pupil, "pupil", "one of the pupils, or None")
        for name in ("opd", "weight", "intensity"):
            refuse_masked(getattr(self, name), name)
        opd, weight = np.array(self.opd, dtype=np.float64), np.array(self.weight, dtype=np.float64)
        if opd.ndim != 2 or opd.shape[0] != opd.shape[1] or opd.shape != weight.shape:
            raise ValueError(
                f"opd and weight must be square and have the same shape, got {opd.shape} and {weight.shape}"
            )
        pixel = check_positive(self.pixel, "pixel", "m")
        if not np.isfinite(weight).all() or (weight < 0.0).any() or not weight.any():
            raise ValueError("weights must be finite, not negative and not all zero")
        lit = weight > 0.0
        if not np.isfinite(opd[lit]).all():
            raise ValueError(
                f"the wavefront must be finite in the pupil, got {(~np.isfinite(opd[lit])).sum()} bad samples"
            )
        opd[~lit] = np.nan
        radius = 0.5 * len(opd) * pixel if self.radius is None else check_positive(self.radius, "radius", "m")
        intensity = weight**2 if self.intensity is None else np.array(self.intensity, dtype=np.float64)
        if intensity.shape == weight.shape:
            intensity[~lit] = 0.0
        least = weight**2 * (1.0 - 1e-9)
        if intensity.shape != weight.shape or not (np.isfinite(intensity) & (intensity >= least)).all():
            raise ValueError("the intensity must be finite, have the weights' shape and be nowhere below their square")
        check_share(self.blocked, "blocked")
        if self.direction is not None and not (np.shape(self.direction) == (3,) and np.isfinite(self.direction).all()):
            raise ValueError(f"the direction must be three finite numbers, got {self.direction!r}")
        error = None if self.error_map is None else np.array(self.error_map, dtype=np.float64)
        if error is not None and not (error.shape == opd.shape and (error[lit] >= 0.0).all()):
            raise ValueError(f"error_map must be lengths of at least 0 m in the shape of opd, {opd.shape}")
        for array in (opd, weight, intensity, *(() if error is None else (error,))):
            array.setflags(write=False)
        checked: dict[str, Any] = {"opd": opd, "weight": weight, "intensity": intensity}
        checked |= {"pixel": pixel, "radius": radius, "error_map": error}
        for name, value in {**checked, "wavelength": check_wavelength(self.wavelength)}.items():
            object.__setattr__(self, name, value)

    @property
    def sign_convention(self) -> str:
        """What a positive OPD means."""
        return SIGN_CONVENTION

    @cached_property
    def aperture(self) -> Pupil | Projected | None:
        """The pupil as it is seen along `direction`, on whose grid the map is."""
        return None if self.pupil is None else seen_along(self.pupil, self.direction)

    @property
    def coordinate(self) -> np.ndarray:
        """X of the columns and y of the rows from the pupil's centre [m], shape (n,)."""
        return self.pixel * (np.arange(len(self.opd)) - 0.5 * (len(self.opd) - 1))

    @property
    def power(self) -> float:
        """Sum of the intensity over the pixels."""
        return float(np.asarray(self.intensity).sum())

    @cached_property
    def lit(self) -> np.ndarray:
        """Mask of the pixels inside the pupil (positive weight), shape (n, n)."""
        return self.weight > 0.0

    @cached_property
    def points(self) -> np.ndarray:
        """X and y of the pixels inside the pupil [m], shape (lit count, 2)."""
        rows, columns = np.nonzero(self.lit)
        return np.stack([self.coordinate[columns], self.coordinate[rows]], axis=1)

    @property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """OPD [m] of the pixels inside the pupil, and weights that sum to 1, each of shape (lit count,)."""
        weight = self.weight[self.lit]
        return self.opd[self.lit], weight / weight.sum()

    @cached_property
    def changes(self) -> Changes | None:
        """How the map changes by each cause of an error; None if that is not known. Computed when first read."""
        return changes_of(self)

    @cached_property
    def error(self) -> ErrorBudget:
        """Error of the OPD of a pixel from the mean [m], by cause and in "total", which covers 95 pixels in 100.

        Empty if it is not known. Some rays are traced again when it is first read.
        """
        with clocked() as spent, stage("error"):
            if self.varied is None and self.budget is not None:
                found = ErrorBudget(self.budget())
            else:
                found = ErrorBudget() if self.changes is None else of_opd(self)
        found.unit = "m"
        self.seconds["error"] = spent["total"]
        return found

    @property
    def opd_error(self) -> float:
        """Total OPD error [m] of the budget; NaN if it is not known."""
        return self.error.get("total", float("nan"))

    @cached_property
    def pixel_errors(self) -> np.ndarray:
        """Error of the OPD of each pixel from the mean [m], shape (n, n); NaN outside the pupil, or if not known.

        It is the spread, at the pixel, of the changes by all causes, of which `error` has the mean over the pupil.
        """
        return of_each_pixel(self)

    def remove(self, *terms: str) -> "Wavefront":
        """Return the wavefront without "piston", "tilt", "focus" or several of them, fitted together by least squares.

        Raises:
            ValueError: An unknown term.
        """
        return without_named(self, check_terms(terms))

    def without_zernike(self, *indices: int) -> "Wavefront":
        """Return the wavefront without Zernike polynomials of these Noll indices, fitted with all up to the greatest.

        Raises:
            ValueError: An index is below 1, or the pupil's samples cannot distinguish so many polynomials.
        """
        if not indices:
            return self
        indices = tuple(check_count(index, "a Noll index") for index in indices)
        self.zernike(max(indices))  # refuses more than the samples can distinguish
        return without_named(self, tuple(f"Z{index}" for index in indices))

    __array_ufunc__ = None  # np.float64(2.0) * wavefront is a wavefront

    __add__, __sub__, __mul__, __rmul__, __truediv__ = plus, minus, times, times, divided
    compare = checked(compare)

    def __neg__(self) -> "Wavefront":
        """The opposite OPD."""
        return times(self, -1.0)

    def at_wavelength(self, wavelength: float) -> "Wavefront":
        """Return the same OPD at another wavelength [m].

        Dispersion of air is ignored (Ciddor: 1 % of OPD from 0.5 to 1 um).
        """
        return replace(self, wavelength=wavelength)

    def strehl(self) -> float:
        """Exact Strehl ratio |<exp(i k OPD)>|^2; `quantities` has its error."""
        opd, weight = self.samples
        check_metres(opd, weight)
        return abs(mean_phasor(opd, weight, self.wavelength)) ** 2

    @property
    def rms(self) -> float:
        """Weighted root mean square of the OPD about its mean [m]."""
        opd, weight = self.samples
        return float(np.sqrt(weighted_mean(weight, (opd - weighted_mean(weight, opd)) ** 2)))

    @property
    def peak_to_valley(self) -> float:
        """Greatest OPD minus least OPD [m]; `quantities` has its error."""
        return float(np.nanmax(self.opd) - np.nanmin(self.opd))

    @property
    def tilt(self) -> np.ndarray:
        """Slopes of the least-squares plane along x and y [rad], shape (2,): the deflection of the beam."""
        opd, weight = self.samples
        return np.asarray(fit_tilt(opd, self.points, weight).tilt)

    zernike = zernike
    zernike_errors = zernike_errors
    zernike_table = zernike_table

    psf, otf, mtf, encircled_energy = psf, otf, mtf, encircled_energy
    centroid = property(centroid)
    fwhm = cached_property(fwhm)
    structure_function = structure_function
    image_quantities = image_quantities

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """Quantities with their errors: "strehl", "opd_rms" [m], "peak_to_valley" [m], "tilt_x", "tilt_y" [rad].

        Each error is the change of the number where the rays change by a cause, and where pixels are finer:
        see changes.py.
        """
        tilt, (strehl, rms, *slopes) = self.tilt, of_samples(self)
        return {
            "strehl": Quantity(self.strehl(), float(strehl), is_ratio=True),
            "opd_rms": Quantity(self.rms, float(rms), "m"),
            "peak_to_valley": Quantity(self.peak_to_valley, of_extremes(self), "m"),
            "tilt_x": Quantity(float(tilt[0]), float(slopes[0]), "rad"),
            "tilt_y": Quantity(float(tilt[1]), float(slopes[1]), "rad"),
        }

    def __repr__(self) -> str:
        """The quantities with their errors. Some rays are retraced for them when they are first read."""
        found = self.quantities
        count, removed = len(self.opd), ", ".join(self.removed) or "nothing"
        rms, valley = (found[name].scaled(1e9, "nm") for name in ("opd_rms", "peak_to_valley"))
        return (
            f"Wavefront of {count} x {count} pixels of {self.pixel:.4g} m at {self.wavelength * 1e9:.6g} nm: Strehl "
            f"ratio {found['strehl']}\n  OPD rms {rms}, peak to valley {valley}; removed: {removed}"
        )

    from_xarray: ClassVar[Callable[..., "Wavefront"]] = classmethod(from_xarray)  # type: ignore[assignment]
    from_samples: ClassVar[Callable[..., "Wavefront"]] = classmethod(from_samples)  # type: ignore[assignment]
    read: ClassVar[Callable[..., "Wavefront"]] = classmethod(read)  # type: ignore[assignment]
    to_xarray = to_xarray
    to_poppy = to_poppy
    to_hcipy = to_hcipy
    to_prysm = to_prysm
    to_fits = to_fits
    to_zemax = to_zemax

    def _picture(self) -> Any:
        half = 0.5 * len(self.opd) * self.pixel
        opd = 1e9 * (self.opd - np.nanmean(self.opd))
        return map_picture(opd, (-half, half, -half, half), ("x", "y"), "OPD from the mean [nm]", "delay")

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the OPD map on matplotlib axes; returns the axes."""
        axes = drawn_on(axes)
        if is_flat(self.opd, "m"):
            say_flat(axes)
            return axes
        half, greatest = 0.5e3 * len(self.opd) * self.pixel, float(np.nanmax(np.abs(self.opd))) * 1e9
        extent = (-half, half, -half, half)
        limits: dict[str, Any] = {"vmin": -greatest, "vmax": greatest}
        picture = axes.imshow(self.opd * 1e9, origin="lower", extent=extent, cmap="RdBu_r", **limits)
        axes.figure.colorbar(picture, ax=axes, label="OPD [nm], positive where light is delayed")
        axes.set(xlabel="x in the pupil [mm]", ylabel="y in the pupil [mm]")
        return axes
