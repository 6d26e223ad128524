"""The result of `wavefront`: a wavefront with its image quantities and its export to other packages."""

from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..display.quantities import Quantity
from ..display.shown import shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_count
from ..pupils import Pupil
from .changes import of_extremes, of_samples
from .data import WavefrontMap
from .image_errors import encircled_errors, intensities, spread_errors, transfer_errors
from .image_quantities import image_quantities
from .modes import StructureFunction, centroid, fit_zernike, structure_function, zernike_errors, zernike_surface
from .point_spread import PointSpread, point_spread_function
from .spot_width import spot_width
from .terms import check_metres, fit_tilt, mean_phasor, remove_terms, weighted_mean
from .transfer import EncircledEnergy, Transfer, encircled, normalised_sensitivity, transfer_function


@shown
class Wavefront(WavefrontMap):
    """A wavefront on a square grid over its pupil; see `WavefrontMap` for its attributes.

    Angles are those of the beam that leaves the pupil along the look direction: OPD = a x, light delayed at +x, turns
    the beam by +a toward +x, and the peak of `psf` is at +a. A distant point seen through the same air appears at -a.
    All are angles in vacuum: in an ambient medium of index n the beam is turned by a / n.
    """

    @classmethod
    @checked
    def from_samples(
        cls,
        points: Numbers,
        opd: Numbers,
        pupil: Pupil,
        wavelength: float,
        *,
        pixel_count: int | None = None,
        opd_error: float | None = None,
    ) -> "Wavefront":
        """Interpolate samples scattered over a pupil to a map: see scattered.py. The error is measured on the samples.

        Args:
            points: Positions of the samples: x and y in the pupil's plane from its centre [m], shape (n, 2), or points
                in space, shape (n, 3), such as the starts of traced rays.
            opd: Their optical path differences [m], positive where light is delayed, shape (n,).
            pupil: The pupil, whose transmission weights the map.
            wavelength: Vacuum wavelength [m].
            pixel_count: As for `wavefront`.
            opd_error: Error of each sample [m], if known; it is added to the error budget.

        Raises:
            TypeError: The wavelength is not a number, or `pupil` is not a pupil.
            ValueError: Shapes disagree; samples are not finite, too few, duplicated or do not cover the pupil; or a
                number is out of range.
        """
        from .scattered import from_scattered

        return cls(wavelength=wavelength, **from_scattered(points, opd, pupil, pixel_count, opd_error))

    def remove(self, *terms: str) -> "Wavefront":
        """Return the wavefront without "piston", "tilt", "focus" or several of them, fitted together by least squares.

        Raises:
            ValueError: An unknown term.
        """
        opd, weight = self.samples
        flat = np.full(self.opd.shape, np.nan)
        flat[self.lit] = remove_terms(opd, terms, self.points, weight)
        return replace(self, opd=flat, removed=tuple(dict.fromkeys((*self.removed, *terms))))

    def without_zernike(self, *indices: int) -> "Wavefront":
        """Return the wavefront without Zernike polynomials of these Noll indices, fitted with all up to the greatest.

        Raises:
            ValueError: An index is below 1, or the pupil's samples cannot distinguish so many polynomials.
        """
        if not indices:
            return self
        indices = tuple(check_count(index, "a Noll index") for index in indices)
        coefficients = self.zernike(max(indices))
        kept = np.zeros(len(coefficients))
        for index in indices:
            kept[index - 1] = coefficients[index - 1]
        names = (*self.removed, *(f"Z{index}" for index in indices))
        return replace(self, opd=self.opd - zernike_surface(self, kept), removed=names)

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
        """Greatest OPD minus least OPD [m]."""
        return float(np.nanmax(self.opd) - np.nanmin(self.opd))

    @property
    def tilt(self) -> np.ndarray:
        """Slopes of the least-squares plane along x and y [rad], shape (2,): the deflection of the beam."""
        opd, weight = self.samples
        return np.asarray(fit_tilt(opd, self.points, weight).tilt)

    @checked
    def zernike(self, count: int) -> np.ndarray:
        """Return the coefficients [m] of the first `count` Zernike polynomials, Noll's index 1 first, shape (count,).

        The polynomials have rms 1 over the disc of `radius` (zernike.py) and are fitted together by weighted least
        squares: on a pupil that is not a disc they are not orthogonal. `zernike_errors` gives the error of each
        coefficient.

        Raises:
            ValueError: A count below 1, or more polynomials than the pupil's samples can distinguish.
        """
        return fit_zernike(self, check_count(count, "count"))

    @checked
    def zernike_errors(self, count: int) -> np.ndarray:
        """Return the error of each Zernike coefficient [m], shape (count,).

        Each is fitted again to maps that changed, and to finer pixels (changes.py). NaN if that is not
        known; infinite if the pupil's samples cannot distinguish the polynomials.

        Raises:
            ValueError: A count below 1.
        """
        return zernike_errors(self, check_count(count, "count"))

    @checked
    def psf(
        self,
        angle: Numbers | None = None,
        *,
        half_width: float | None = None,
        padding: int = 8,
        wavelengths: Numbers | None = None,
        weights: Numbers | None = None,
    ) -> PointSpread:
        """Return the point spread function over the peak of the perfect one; arguments as in `point_spread_function`.

        With `wavelengths` [m], shape (n,), it is the one of polychromatic light with this OPD at all wavelengths.
        `weights` are the shares of the light at the wavelengths, equal if None: see `over_wavelengths`.
        """
        if wavelengths is not None or weights is not None:
            from .polychromatic import polychromatic_psf

            return polychromatic_psf(self, wavelengths, weights, angle, half_width, padding)
        options: dict[str, Any] = {"half_width": half_width, "padding": padding, "angle": angle}
        found = point_spread_function(self.opd, self.weight, self.pixel, self.wavelength, **options)
        return replace(found, errors=partial(spread_errors, self, found.angle, intensities))

    def otf(self) -> Transfer:
        """Return the complex optical transfer function."""
        return replace(transfer_function(self), errors=partial(transfer_errors, self, False))

    def mtf(self) -> Transfer:
        """Return the modulation transfer function, the magnitude of the OTF."""
        otf = self.otf()
        return replace(otf, value=np.abs(otf.value), errors=partial(transfer_errors, self, True))

    @checked
    def encircled_energy(self, angle: Numbers | None = None, *, center: Numbers | None = None) -> EncircledEnergy:
        """Return the share of the light within an angle about a point of the image, exact for the pixels of the map.

        All light counts as being within wavelength / (2 pixel) along either axis, the range that the pixels can
        represent.

        Args:
            angle: Angles [rad], any shape; None takes 65 up to eight times wavelength / width.
            center: The point [rad], two numbers along x and y; None takes the centroid.

        Raises:
            ValueError: An angle is negative or not finite, or `center` is not two finite angles.
        """
        width = len(self.opd) * self.pixel
        angle = np.linspace(0.0, 8.0 * self.wavelength / width, 65) if angle is None else np.asarray(angle, dtype=float)
        if not (np.isfinite(angle) & (angle >= 0.0)).all():
            raise ValueError(f"angle must be finite and at least 0 rad, got {angle!r}")
        point = self.centroid if center is None else np.asarray(center, dtype=float)
        if center is None and not np.isfinite(point).all():
            raise ValueError("no pixel has a neighbour, so there is no centroid: give `center` or more pixels")
        if point.shape != (2,) or not np.isfinite(point).all():
            raise ValueError(f"center must be two angles along x and y [rad], got {center!r}")
        errors = partial(encircled_errors, self, angle, None if center is None else point)
        return EncircledEnergy(angle, encircled(self.otf(), angle, point), point, errors)

    @property
    def centroid(self) -> np.ndarray:
        """Centroid of the point spread function, along x and y [rad], shape (2,): the mean slope of the OPD."""
        return centroid(self)

    @cached_property
    def fwhm(self) -> float:
        """Full width at half maximum of the point spread function [rad]: see `PointSpread.fwhm`.

        It counts all area above half of the peak, including spots apart from the one that holds the peak.
        """
        return spot_width(self)[0]

    def structure_function(self) -> StructureFunction:
        """Return the mean square OPD difference of pairs of points by their distance."""
        return structure_function(self)

    @checked
    def pssn(self, fried: float = np.inf) -> float:
        """Return the normalised point source sensitivity, 1 without aberrations; `fried` is the atmosphere's r0 [m]."""
        if not fried > 0.0:
            raise ValueError(f"fried, the atmosphere's r0, must be a positive length [m], got {fried!r}")
        return normalised_sensitivity(self.otf(), self.wavelength, float(fried))

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

    def image_quantities(self, fried: float = np.inf) -> dict[str, Quantity]:
        """Return quantities of the image with their errors: "centroid_x", "centroid_y", "fwhm" [rad], "pssn".

        `fried` is as in `pssn`. The errors are found as those of `quantities`.
        """
        return image_quantities(self, fried)

    @checked
    def over_wavelengths(self, wavelengths: Numbers, angle: Numbers | None = None, weights: Numbers | None = None):
        """Return image quantities at several wavelengths [m] as an xarray.Dataset with a wavelength axis.

        The OPD is the same at all wavelengths: dispersion of air is ignored, see `at_wavelength`. The dataset holds
        `strehl`, `strehl_error`, `fwhm` [rad] and `psf` over (wavelength, y, x). `angle` are the angles of the rows and
        columns of `psf` [rad], shape (m,); None takes 33 up to four times the longest wavelength over the pupil's
        width. `weights` are the shares of the light at the wavelengths, equal if None; `polychromatic_psf` over (y, x)
        is the point spread function of all the light, over its peak without aberrations.
        """
        from .exchange.wavelengths import over_wavelengths

        return over_wavelengths(self, wavelengths, angle, weights)

    def __repr__(self) -> str:
        """The quantities with their errors. Some rays are retraced for them when they are first read."""
        found = self.quantities
        count, removed = len(self.opd), ", ".join(self.removed) or "nothing"
        nanometres = f"{self.wavelength * 1e9:.6g} nm"
        return "\n".join(
            [
                f"Wavefront of {count} x {count} pixels of {self.pixel:.4g} m at {nanometres}: Strehl ratio "
                f"{found['strehl']}",
                f"  OPD rms {found['opd_rms'].scaled(1e9, 'nm')}, peak to valley "
                f"{found['peak_to_valley'].scaled(1e9, 'nm')}; removed: {removed}",
            ]
        )

    def to_xarray(self):
        """Return an xarray.Dataset of OPD and weight over (y, x), with units and CF attributes; see `from_xarray`."""
        from .exchange.netcdf import to_xarray

        return to_xarray(self)

    @classmethod
    def from_xarray(cls, dataset) -> "Wavefront":
        """Make the wavefront of a dataset of `to_xarray`, or of one read from its NetCDF file."""
        from .exchange.netcdf import from_xarray

        return cls(**from_xarray(dataset))

    def to_poppy(self):
        """Return a poppy.ArrayOpticalElement with the pupil's amplitude and the OPD in poppy's sign."""
        from .exchange.poppy import to_poppy

        return to_poppy(self)

    def to_hcipy(self):
        """Return a hcipy.Wavefront: the electric field on a grid in the pupil's plane."""
        from .exchange.hcipy import to_hcipy

        return to_hcipy(self)

    def to_prysm(self):
        """Return a prysm.propagation.Wavefront of the pupil: dx in mm, wavelength in um."""
        from .exchange.prysm import to_prysm

        return to_prysm(self)

    def to_fits(self, path) -> None:
        """Write amplitude and OPD as FITS for poppy.FITSOpticalElement: see exchange/fits.py."""
        from .exchange.fits import to_fits

        to_fits(self, path)

    def to_zemax(self, path, kind: str = "phase") -> None:
        """Write a Zemax grid file: `kind` "phase" [rad] or "sag" [mm]; see exchange/zemax.py."""
        from .exchange.zemax import to_zemax

        to_zemax(self, path, kind)

    def plot(self, axes=None):
        """Draw the OPD map on matplotlib axes; returns the axes."""
        from .plots import plot_opd

        return plot_opd(self, axes)
