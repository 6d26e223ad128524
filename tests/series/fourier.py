"""Random density fields of Fourier modes, whose line integrals have closed forms.

rho(x, t) = rho_0 + sum over k of  a cos(k . (x - U t) + phase_k)
integral over s from 0 to S along x + s d:  a (sin(p + w S) - sin(p)) / w,  p = k . x + phase,  w = k . d
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.flow import refractivity_model

WAVELENGTH = 905e-9
CONSTANT = float(refractivity_model().constant(WAVELENGTH))  # of the default relation


@dataclass
class Fourier:
    """A field of modes.

    Attributes:
        k: Wave vectors [rad/m], shape (m, 3).
        phase: Phases [rad], shape (m,).
        amplitude: Amplitude of each mode [kg/m3].
        mean: Mean density [kg/m3].
        velocity: Convection velocity [m/s].
    """

    k: np.ndarray
    phase: np.ndarray
    amplitude: float
    mean: float = 0.5
    velocity: tuple[float, float, float] = (300.0, 0.0, 0.0)

    @classmethod
    def random(cls, seed: int, modes: int = 12, wavenumber: float = 60.0, amplitude: float = 0.004) -> "Fourier":
        """Normal wave vectors of a standard deviation `wavenumber` [rad/m] in each direction, and uniform phases."""
        draw = np.random.default_rng(seed)
        return cls(draw.normal(size=(modes, 3)) * wavenumber, draw.uniform(0.0, 2.0 * np.pi, modes), amplitude)

    def density(self, points: np.ndarray, time: float) -> np.ndarray:
        """Density [kg/m3] at points [m], shape (..., 3)."""
        moved = points - np.array(self.velocity) * time
        return self.mean + self.amplitude * np.cos(moved @ self.k.T + self.phase).sum(axis=-1)

    def on_grid(self, origin: Any, spacing: float, shape: Any, time: float, kind: Any = np.float64) -> np.ndarray:
        """Density at the nodes of a grid [x, y, z], of the type `kind`."""
        axes = [origin[k] + spacing * np.arange(shape[k]) - self.velocity[k] * time for k in range(3)]
        parts = [np.exp(1j * axes[k][:, None] * self.k[:, k]) for k in range(3)]
        found = np.empty(shape, kind)
        for i, first in enumerate(parts[0] * np.exp(1j * self.phase)):
            found[i] = self.mean + self.amplitude * ((first * parts[1]) @ parts[2].T).real
        return found

    def opd(self, start: np.ndarray, direction: np.ndarray, length: np.ndarray, time: float) -> np.ndarray:
        """The exact optical path difference [m] along straight lines."""
        at = (start - np.array(self.velocity) * time) @ self.k.T + self.phase
        along = self.k @ direction
        # (sin(at + w) - sin(at)) / along, written as sinc to avoid 0 / 0 where a mode is constant along a line
        half = 0.5 * along * np.asarray(length)[..., None]
        parts = np.asarray(length)[..., None] * np.sinc(half / np.pi) * np.cos(at + half)
        return np.asarray(CONSTANT * self.amplitude * parts.sum(axis=-1))
