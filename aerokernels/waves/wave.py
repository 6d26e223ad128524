r"""A monochromatic wave, and its way through homogeneous air by the angular spectrum: exact for what pixels resolve.

    A(x, z) = F^-1 [ F[A](f) exp(i z (sqrt(k^2 - K^2) - k)) ],      K = 2 pi f, k = 2 pi n / lambda

or -K^2 / (2 k) in place of the root minus k (J. W. Goodman, Introduction to Fourier Optics, 3.10).
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..display.quantities import Quantity
from ..display.shown import drawn_on, shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_at_least, check_positive, check_wavelength, warn_caller
from ..pupils import as_unit_vector, as_vector, transverse_axes
from ..wavefronts import PointSpread
from ..wavefronts.point_spread import far_field

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def transfer_exponent(
    shape: tuple[int, int], pixel: float, wavelength: float, ambient_index: float, paraxial: bool
) -> np.ndarray:
    """Return the exponent of each Fourier component per metre, complex, shape (rows, columns), in SciPy's order."""
    wave_number = 2.0 * np.pi * ambient_index / wavelength
    up, right = (2.0 * np.pi * np.fft.fftfreq(count, pixel) for count in shape)
    square = up[:, None] ** 2 + right**2
    if paraxial:
        return np.asarray(-0.5j * square / wave_number)
    # root - k without cancellation.
    root = np.sqrt((wave_number**2 - square).astype(np.complex128))
    return np.asarray(-1j * square / (root + wave_number))


def as_amplitude(values) -> np.ndarray:
    """Return complex or real numbers as a complex array."""
    try:
        return np.asarray(values, dtype=np.complex128)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(
            f"the amplitude must be an array of complex or real numbers, got {type(values).__name__}"
        ) from None


@checked
def angular_spectrum(
    amplitude,
    pixel: float,
    wavelength: float,
    distance: float,
    *,
    ambient_index: float = 1.0,
    paraxial: bool = False,
) -> np.ndarray:
    """Return the complex amplitude after a distance, of the same shape, without the phase of the axial plane wave.

    Args:
        amplitude: Complex amplitude over square pixels, shape (rows, columns), axes [y, x]; one row for a
            one-dimensional problem.
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        distance: Distance of propagation [m]; negative propagates back.
        ambient_index: Refractive index of the air.
        paraxial: Whether to solve the paraxial equation (Fresnel) instead of Helmholtz's.

    Raises:
        TypeError: An argument is of the wrong type.
        ValueError: The amplitude is not a two-axis array of finite numbers, the wavelength is outside 0.1 to 24 um, the
            pixel or the index is not positive, or the distance is not finite.
    """
    from scipy.fft import fft2, ifft2

    amplitude = as_amplitude(amplitude)
    if amplitude.ndim != 2 or not amplitude.size or not np.isfinite(amplitude).all():
        raise ValueError(f"the amplitude must be finite and have two axes [y, x], got shape {amplitude.shape}")
    wavelength, distance = check_wavelength(wavelength), check_at_least(distance, "distance")
    pixel, ambient_index = check_positive(pixel, "pixel", "m"), check_positive(ambient_index, "ambient_index")
    exponent = transfer_exponent(amplitude.shape, pixel, wavelength, ambient_index, paraxial)
    if distance < 0.0:  # evanescent waves do not grow
        exponent = 1j * exponent.imag
    return np.asarray(ifft2(fft2(amplitude) * np.exp(distance * exponent)))


class WrappedWaveWarning(UserWarning):
    """Light leaves the window of a wave, and comes back on its other side."""


def wrapped_share(wave: "Wave", distance: float) -> float:
    """Return the share of the light that certainly leaves the periodic window over a distance [m], by either axis.

    A component of the angular spectrum with the slope t moves by the distance times t. All light starts within the lit
    part of the window: if the whole lit part, moved so far, is beyond a side, the component's light has left.
    """
    from scipy.fft import fft2, fftfreq

    light, spectrum = np.abs(wave.amplitude) ** 2, np.abs(fft2(wave.amplitude)) ** 2
    worst = 0.0
    for axis in (0, 1):
        begun = np.cumsum(light.sum(axis=1 - axis))
        first, last = np.searchsorted(begun, np.array([1e-4, 1.0 - 1e-4]) * begun[-1])
        count = begun.size
        sine = fftfreq(count, wave.pixel) * wave.wavelength / wave.ambient_index
        slope = sine / np.sqrt(np.maximum(1.0 - sine**2, np.finfo(np.float64).tiny))
        moved = np.where(np.abs(sine) < 1.0, slope * distance / wave.pixel, 0.0)  # the others are evanescent
        left = (first + moved > count - 0.5) | (last + moved < -0.5)
        by_component = spectrum.sum(axis=1 - axis)
        worst = max(worst, float(by_component[left].sum() / by_component.sum()))
    return worst


def warn_of_wrapping(wave: "Wave", distance: float) -> None:
    """Warn if more than a thousandth of the light leaves the window over a distance [m]."""
    share, (rows, columns) = wrapped_share(wave, distance), wave.amplitude.shape
    if share > 1e-3:
        warn_caller(
            f"over {distance:.4g} m at least {100.0 * share:.2g} % of the light leaves the window of "
            f"{columns * wave.pixel:.4g} m x {rows * wave.pixel:.4g} m, which is periodic, and comes back on its other "
            "side: the amplitude is not that of free space; take a wider window, or a Wave with a margin of zeros",
            WrappedWaveWarning,
        )


@shown
@dataclass(frozen=True, eq=False, repr=False)
class Wave:
    """A monochromatic wave on a plane, without the phase of the plane wave along its axis in ambient air.

    A growing phase is a delay: exp(i k OPD), as in all of aerokernels.

    Attributes:
        amplitude: Complex amplitude at the pixels' centres, shape (rows, columns), axes [y, x] along `axes`.
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        center: Middle of the window [m], shape (3,).
        normal: Direction in which the wave travels, normalised, shape (3,).
        ambient_index: Refractive index of the undisturbed air.
        incident: Sum of the initial amplitude, which `strehl` compares with.
        error: Error of the amplitude due to the steps and the layers in which the field is sampled, rms over the rms
            amplitude; NaN if not known.
        strehl_error: Error of `strehl` due to steps, layers and pixels, measured with half as many of each, and due to
            the pixels on a pupil's edge; NaN if not known. It excludes light that re-enters through the sides of the
            periodic window.
        step_count: Number of steps through a field.
        seconds: Wall time by stage: see STAGES in clock.py.

    Raises:
        ValueError: The amplitude is not a two-axis array of finite numbers, or is zero everywhere; the pixel or the
            index is not positive; or the wavelength is outside 0.1 to 24 um.
    """

    amplitude: np.ndarray
    pixel: float
    wavelength: float
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    ambient_index: float = 1.0
    incident: complex | None = None
    error: float = 0.0
    strehl_error: float = float("nan")
    step_count: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self):
        """Check the values and store a read-only copy."""
        amplitude = np.array(as_amplitude(self.amplitude))
        if amplitude.ndim != 2 or not np.isfinite(amplitude).all() or not amplitude.any():
            raise ValueError(
                f"the amplitude must be finite, not zero everywhere and have two axes [y, x], got {amplitude.shape}"
            )
        check_positive(self.pixel, "pixel", "m")
        check_positive(self.ambient_index, "ambient_index")
        amplitude.setflags(write=False)
        checked = {
            "amplitude": amplitude,
            "wavelength": check_wavelength(self.wavelength),
            "center": as_vector(self.center, "center"),
            "normal": as_unit_vector(self.normal, "normal"),
            "incident": complex(amplitude.sum()) if self.incident is None else self.incident,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors along columns and rows: x and y for a wave along z."""
        return transverse_axes(self.normal)

    @property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """X of the columns and y of the rows from the centre [m]."""
        rows, columns = self.amplitude.shape
        x, y = (self.pixel * (np.arange(count) - count // 2) for count in (columns, rows))
        return x, y

    @property
    def intensity(self) -> np.ndarray:
        """Squared magnitude of the amplitude, shape (rows, columns)."""
        return np.abs(self.amplitude) ** 2

    @checked
    def propagate(self, distance: float, *, paraxial: bool = False) -> "Wave":
        """Return the wave after a distance [m] in ambient air: see angular_spectrum.py.

        Warns:
            WrappedWaveWarning: Light leaves the window, which is periodic, and comes back on its other side.

        Raises:
            ValueError: The distance is not finite.
        """
        moved = propagated(self, distance, paraxial)
        warn_of_wrapping(self, distance)
        return moved

    def strehl(self) -> float:
        """Return the Strehl ratio: far-field intensity along the axis over the one of the initial wave.

        The far-field amplitude is the sum over the plane, which free space conserves. NaN if the initial wave has no
        light along its axis, as an odd mode.
        """
        with np.errstate(invalid="ignore"):
            return float(abs(self.amplitude.sum() / self._reference) ** 2)

    @property
    def _reference(self) -> complex:
        """Sum of the initial amplitude, the reference of far fields; NaN if it is only rounding."""
        assert self.incident is not None
        rounding = 1e-12 * float(np.abs(self.amplitude).sum())
        return complex(self.incident) if abs(self.incident) > rounding else complex("nan")

    @checked
    def psf(self, angle: Numbers) -> PointSpread:
        """Return the far-field intensity at angles of rows and columns [rad], shape (m,), over the undisturbed peak.

        Raises:
            ValueError: The angles are not finite, or have more than one axis.
        """
        angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
        if angle.ndim != 1 or not np.isfinite(angle).all():
            raise ValueError(f"angle must be finite angles [rad], shape (m,), got shape {angle.shape}")
        spectrum = far_field(self.amplitude, self.coordinates, angle, self.wavelength)
        with np.errstate(invalid="ignore"):
            return PointSpread(np.abs(spectrum / self._reference) ** 2, angle)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the intensity over the window [mm] on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        x, y = (1e3 * axis for axis in self.coordinates)
        half = 0.5e3 * self.pixel
        ends = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
        drawn = axes.imshow(self.intensity, origin="lower", extent=ends, cmap="inferno")
        axes.figure.colorbar(drawn, ax=axes, label="intensity")
        axes.set(xlabel="x in the window [mm]", ylabel="y in the window [mm]")
        return axes

    def __repr__(self) -> str:
        """Size, pixel, wavelength, Strehl ratio and errors."""
        rows, columns = self.amplitude.shape
        return (
            f"Wave of {rows} x {columns} pixels of {self.pixel:.4g} m at {self.wavelength * 1e9:.6g} nm: Strehl ratio "
            f"{Quantity(self.strehl(), self.strehl_error, is_ratio=True)} after {self.step_count} steps, amplitude "
            f"error {self.error:.2g}"
        )


def propagated(wave: Wave, distance: float, paraxial: bool) -> Wave:
    """Return a wave after a distance [m] in ambient air, with what has left its window on the other side."""
    moved = angular_spectrum(
        wave.amplitude, wave.pixel, wave.wavelength, distance, ambient_index=wave.ambient_index, paraxial=paraxial
    )
    return replace(wave, amplitude=moved, center=wave.center + distance * wave.normal)
