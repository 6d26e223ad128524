r"""A focused laser differential interferometer, and its response to sine waves in closed form.

    w(z)^2 = w_0^2 + (theta z)^2,       H(K, z) = sin(K s / 2) / (K s / 2)  exp(-K^2 w(z)^2 / 8)

for the wave number K along the separation s (B. E. Schmidt, J. E. Shepherd, Appl. Opt. 54 (2015) 8459).
"""

from dataclasses import dataclass, field

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive
from ..inputs.wavelength import check_wavelength
from ..pupils import as_unit_vector, as_vector, transverse_axes


@checked
@dataclass(frozen=True, eq=False)
class FLDI:
    """An FLDI instrument.

    Attributes:
        separation: Distance between the two beams [m].
        waist: Radius of a beam at the focus, at 1 / e^2 of its intensity [m].
        focus: Point midway between the beams at their focus [m], shape (3,).
        axis: Direction of the beams, normalised, shape (3,).
        direction: Direction from the second beam to the first, projected across the axis and normalised, shape (3,);
            None takes the first transverse axis, x for beams along z.
        wavelength: Vacuum wavelength [m].
        divergence: Half angle of the beams far from the focus [rad]; None takes wavelength / (pi waist).

    Raises:
        TypeError: The wavelength is not a number.
        ValueError: A number is out of range, or the direction is along the axis.
    """

    separation: float
    waist: float
    focus: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    direction: np.ndarray | None = None
    wavelength: float = 632.8e-9
    divergence: float | None = None

    def __post_init__(self):
        """Check and normalise the values."""
        axis = as_unit_vector(self.axis, "axis")
        direction = transverse_axes(axis)[0] if self.direction is None else as_unit_vector(self.direction, "direction")
        across = direction - (direction @ axis) * axis
        if np.linalg.norm(across) < 1e-6:
            raise ValueError("direction, from one beam to the other, must not lie along the axis")
        wavelength = check_wavelength(self.wavelength)
        waist = check_positive(self.waist, "waist")
        spread = wavelength / (np.pi * waist) if self.divergence is None else self.divergence
        if not (np.ndim(spread) == 0 and np.isfinite(spread) and 0.0 <= spread < 0.5 * np.pi):
            raise ValueError(f"divergence must be a half angle in [0, pi/2) rad, got {self.divergence!r}")
        checked = {
            "separation": check_positive(self.separation, "separation"),
            "waist": waist,
            "focus": as_vector(self.focus, "focus"),
            "axis": axis,
            "direction": across / np.linalg.norm(across),
            "wavelength": wavelength,
            "divergence": float(spread),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def normal(self) -> np.ndarray:
        """Unit vector perpendicular to axis and direction, shape (3,)."""
        assert self.direction is not None
        return np.cross(self.axis, self.direction)

    @checked
    def radius(self, distance: Numbers) -> np.ndarray:
        """Return the radius of a beam [m] at distances from the focus along the axis [m], of their shape."""
        assert self.divergence is not None
        return np.hypot(self.waist, np.tan(self.divergence) * np.asarray(distance, dtype=np.float64))

    @checked
    def transfer(self, wave_number: Numbers, distance: Numbers = 0.0, *, angle: float = 0.0) -> np.ndarray:
        """Return H of a sine wave in a sheet, in closed form, of the arguments' common shape.

        Args:
            wave_number: Wave number, 2 pi over the wavelength of the sine [rad / m].
            distance: Distance from the focus to the sheet along the axis [m].
            angle: Angle between the wave's direction and the separation [rad].
        """
        wave_number, distance = (np.asarray(each, dtype=np.float64) for each in (wave_number, distance))
        if not (np.isfinite(wave_number).all() and np.isfinite(distance).all() and np.isfinite(angle)):
            raise ValueError("wave_number, distance and angle must be finite")
        try:
            np.broadcast_shapes(wave_number.shape, distance.shape)
        except ValueError:
            raise ValueError(
                f"wave_number and distance must have shapes that broadcast, got {wave_number.shape} and "
                f"{distance.shape}: for every pair give wave_number[:, None]"
            ) from None
        apart = np.sinc(wave_number * np.cos(angle) * self.separation / (2.0 * np.pi))
        return np.asarray(apart * np.exp(-((wave_number * self.radius(distance)) ** 2) / 8.0))

    @checked
    def transfer_through(self, wave_number: Numbers, half_length: float, *, angle: float = 0.0) -> np.ndarray:
        """Return the mean of H over sheets from -half_length to +half_length about the focus [m], in closed form."""
        from scipy.special import erf

        assert self.divergence is not None
        wave_number = np.asarray(wave_number, dtype=np.float64)
        grown = (
            np.abs(wave_number) * np.tan(self.divergence) * check_positive(half_length, "half_length") / np.sqrt(8.0)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(grown > 1e-9, 0.5 * np.sqrt(np.pi) * erf(grown) / grown, 1.0)
        return np.asarray(mean * self.transfer(wave_number, 0.0, angle=angle))
