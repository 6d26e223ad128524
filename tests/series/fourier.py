"""Random density fields of Fourier modes, whose line integrals are closed forms.

rho(x, t) = rho_0 + sum over k of  a cos(k . (x - U t) + phase_k)
integral over s from 0 to S along x + s d:  a (sin(p + w S) - sin(p)) / w,  p = k . x + phase,  w = k . d
"""

from dataclasses import dataclass

import numpy as np

from aerokernels import flow

WAVELENGTH = 905e-9
CONSTANT = flow.gladstone_dale_constant(WAVELENGTH)


@dataclass
class Fourier:
    """Modes `k` [rad/m], shape (m, 3), `phase` [rad], one amplitude [kg/m3], mean density and velocity [m/s]."""

    k: np.ndarray
    phase: np.ndarray
    amplitude: float
    mean: float = 0.5
    velocity: tuple[float, float, float] = (300.0, 0.0, 0.0)

    @classmethod
    def random(cls, seed: int, modes: int = 12, wavenumber: float = 60.0, amplitude: float = 0.004) -> "Fourier":
        draw = np.random.default_rng(seed)
        return cls(draw.normal(size=(modes, 3)) * wavenumber, draw.uniform(0.0, 2.0 * np.pi, modes), amplitude)

    def density(self, points: np.ndarray, time: float) -> np.ndarray:
        moved = points - np.array(self.velocity) * time
        return self.mean + self.amplitude * np.cos(moved @ self.k.T + self.phase).sum(axis=-1)

    def on_grid(self, origin, spacing: float, shape, time: float) -> np.ndarray:
        axes = [origin[k] + spacing * np.arange(shape[k]) for k in range(3)]
        moved = [axes[k][:, None] - self.velocity[k] * time for k in range(3)]
        parts = [np.exp(1j * moved[k] * self.k[:, k]) for k in range(3)]
        total = np.einsum("xm,ym,zm,m->xyz", *parts, np.exp(1j * self.phase), optimize=True)
        return self.mean + self.amplitude * total.real

    def opd(self, start: np.ndarray, direction: np.ndarray, length: np.ndarray, time: float) -> np.ndarray:
        """The exact optical path difference [m] along straight lines."""
        at = (start - np.array(self.velocity) * time) @ self.k.T + self.phase
        along = self.k @ direction
        parts = (np.sin(at + along * np.asarray(length)[..., None]) - np.sin(at)) / along
        return CONSTANT * self.amplitude * parts.sum(axis=-1)
