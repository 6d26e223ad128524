"""Light as a complex amplitude over a window of square pixels."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..display.shown import drawn_on, shown
from ..inputs.checks import check_positive
from ..inputs.wavelength import check_wavelength
from ..pupils import as_unit_vector, as_vector, transverse_axes
from ..wavefront import PointSpread
from ..wavefront.point_spread import far_field
from .angular_spectrum import angular_spectrum


@shown
@dataclass(frozen=True, eq=False, repr=False)
class Wave:
    """A monochromatic wave across a plane; the phase of the plane wave along its axis in ambient air is taken out.

    A phase that grows is a delay: exp(i k OPD), as everywhere.

    Attributes:
        amplitude: Complex amplitude at the pixels' centres, shape (rows, columns), axes [y, x] along `axes`.
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        center: Middle of the window [m], shape (3,).
        normal: Direction in which the wave travels, made a unit vector, shape (3,).
        ambient_index: Index of the air at rest.
        incident: Sum of the amplitude that it began with, to which `strehl` compares.
        error: What the amplitude may be off by through the steps, rms over the rms amplitude; NaN where not known.
        strehl_error: What `strehl` may be off by through the steps and the pixels, by half as many of either; NaN where
            not known. What comes back from beyond the window's sides is not in it.
        step_count: Steps through a field.
        seconds: Wall time by stage: see STAGES in clock.py.

    Raises:
        ValueError: An amplitude that is no two-axis array of finite numbers, or dark; a pixel that is not positive; a
            wavelength outside 0.1 to 20 um.
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
        """Check and make a read-only copy."""
        amplitude = np.array(self.amplitude, dtype=np.complex128)
        if amplitude.ndim != 2 or not np.isfinite(amplitude).all() or not amplitude.any():
            raise ValueError(
                f"the amplitude must be finite, of two axes [y, x] and not dark everywhere, got shape {amplitude.shape}"
            )
        if not (np.ndim(self.pixel) == 0 and np.isfinite(self.pixel) and self.pixel > 0.0):
            raise ValueError(f"the pixel must be a positive length [m], got {self.pixel!r}")
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

    def propagate(self, distance: float, *, paraxial: bool = False) -> "Wave":
        """The wave a distance [m] farther on in ambient air: see angular_spectrum.py."""
        moved = angular_spectrum(
            self.amplitude,
            self.pixel,
            self.wavelength,
            distance,
            ambient_index=self.ambient_index,
            paraxial=paraxial,
        )
        return replace(self, amplitude=moved, center=self.center + distance * self.normal)

    def strehl(self) -> float:
        """Strehl ratio: intensity far away along the axis over that of the wave that it began as.

        The amplitude's sum over the plane, which free space leaves alone. NaN where the wave began with no light along
        its axis, as an odd mode does.
        """
        with np.errstate(invalid="ignore"):
            return float(abs(self.amplitude.sum() / self._reference) ** 2)

    @property
    def _reference(self) -> complex:
        """The sum that far fields are compared with; NaN where it is nothing but rounding."""
        assert self.incident is not None
        rounding = 1e-12 * float(np.abs(self.amplitude).sum())
        return complex(self.incident) if abs(self.incident) > rounding else complex("nan")

    def psf(self, angle) -> PointSpread:
        """Intensity far away at angles of rows and columns [rad], shape (m,), over the undisturbed peak.

        Raises:
            ValueError: Angles that are not finite, or of more than one axis.
        """
        angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
        if angle.ndim != 1 or not np.isfinite(angle).all():
            raise ValueError(f"angle must be finite angles [rad], shape (m,), got shape {angle.shape}")
        spectrum = far_field(self.amplitude, self.coordinates, angle, self.wavelength)
        with np.errstate(invalid="ignore"):
            return PointSpread(np.abs(spectrum / self._reference) ** 2, angle)

    def plot(self, axes=None):
        """Draw the intensity over the window [mm] on matplotlib axes; returns the axes."""
        axes = drawn_on(axes)
        x, y = (1e3 * axis for axis in self.coordinates)
        half = 0.5e3 * self.pixel
        ends = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
        drawn = axes.imshow(self.intensity, origin="lower", extent=ends, cmap="inferno")
        axes.figure.colorbar(drawn, ax=axes, label="intensity")
        axes.set(xlabel="x in the window [mm]", ylabel="y in the window [mm]")
        return axes

    def __repr__(self) -> str:
        """Size, place and Strehl ratio."""
        rows, columns = self.amplitude.shape
        return (
            f"Wave of {rows} x {columns} pixels of {self.pixel:.4g} m at {self.wavelength * 1e9:.6g} nm: Strehl ratio "
            f"{self.strehl():.6g} +- {self.strehl_error:.2g} after {self.step_count} steps, amplitude error "
            f"{self.error:.2g}"
        )
