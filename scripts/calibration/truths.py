"""Random contrasts in units of cells, with their integrals along straight lines."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from aerokernels.tracing.variants.paths import Rays

# Longest wave of turbulence [cells], and number of waves.
LONGEST, WAVES = 40.0, 300
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)


def integrals(
    call: Callable, start: np.ndarray, end: np.ndarray, pieces_per_cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return int f ds and int (length left) f ds of a function of points, along lines, by Gauss points; (n,) each."""
    length = np.linalg.norm(end - start, axis=1)
    pieces = int(np.ceil(length.max() * pieces_per_cell))
    share = ((np.arange(pieces) + 0.5)[:, None] + 0.5 * GAUSS).ravel() / pieces
    first, second = np.zeros((2, len(start)))
    for part in np.array_split(share, max(1, len(share) * len(start) // 2_000_000)):
        value = call(start[:, None] + part[:, None] * (end - start)[:, None])
        first += value.sum(axis=1)
        second += (value * (1.0 - part)).sum(axis=1)
    return first * length / len(share), second * length**2 / len(share)


@dataclass
class Formula:
    """A contrast given as a function of points (.., 3)."""

    call: Callable[[np.ndarray], np.ndarray]
    pieces: float = 24.0

    def lines(self, start: np.ndarray, end: np.ndarray, beyond: np.ndarray) -> Rays:
        """Return OPD, change of direction and displacement at lengths `beyond` the lines' ends (n,), all in cells."""
        return by_shifts(lambda a, b: integrals(self.call, a, b, self.pieces), start, end, beyond)


def by_shifts(call: Callable, start: np.ndarray, end: np.ndarray, beyond: np.ndarray, tiny: float = 0.02) -> Rays:
    """Return what lines bring, their turn and displacement from lines shifted across."""
    way = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    first = np.cross(way, np.where(np.abs(way[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    opd, _ = call(start, end)
    turned, moved = np.zeros((2, *start.shape))
    for axis in (first, np.cross(way, first)):
        low, high = (call(start + sign * tiny * axis, end + sign * tiny * axis) for sign in (-1.0, 1.0))
        turn, move = ((b - a) / (2.0 * tiny) for a, b in zip(low, high, strict=True))
        turned += turn[:, None] * axis
        moved += (move + beyond * turn)[:, None] * axis
    return Rays(opd, turned, moved)


@dataclass
class Waves:
    """A sum of cosines with a Kolmogorov spectrum up to a share of the Nyquist wave number, integrated exactly."""

    wave: np.ndarray
    size: np.ndarray
    phase: np.ndarray

    @classmethod
    def random(cls, rng: np.random.Generator, top: float, count: int, faded: bool, planar: bool) -> "Waves":
        """Draw waves of a box of `count` nodes a side; `faded` along z by sin^2."""
        wave = rng.normal(size=(WAVES, 3)) * ([0.0, 1.0, 1.0] if planar else 1.0)
        wave /= np.linalg.norm(wave, axis=1)[:, None]
        low, high = 2.0 * np.pi / LONGEST, np.pi * top
        number = low * (high / low) ** rng.random(WAVES)
        size, phase, wave = number ** (1.5 - 11.0 / 6.0), rng.uniform(0.0, 2.0 * np.pi, WAVES), wave * number[:, None]
        if faded:
            beside = np.array([0.0, 0.0, 2.0 * np.pi / (count - 1)])
            wave = np.concatenate([wave, wave + beside, wave - beside])
            size, phase = np.concatenate([size / 2.0, -size / 4.0, -size / 4.0]), np.tile(phase, 3)
        return cls(wave, size, phase)

    def nodes(self, axes: list[np.ndarray]) -> np.ndarray:
        """Return the values at nodes, along two axes (y, z) or three."""
        turns = [np.exp(1j * np.outer(self.wave[:, k], x)) for k, x in zip(range(3 - len(axes), 3), axes, strict=True)]
        weight = self.size * np.exp(1j * self.phase)
        if len(axes) == 2:
            return np.real((weight[:, None] * turns[0]).T @ turns[1])
        left = (weight[:, None, None] * turns[0][:, :, None] * turns[1][:, None, :]).reshape(len(weight), -1)
        return np.real(left.T @ turns[2]).reshape([len(x) for x in axes])

    def lines(self, start: np.ndarray, end: np.ndarray, beyond: np.ndarray) -> Rays:
        """As `Formula.lines`, in closed form."""
        length = np.linalg.norm(end - start, axis=1)[:, None]
        way = (end - start) / length
        rate, phase = way @ self.wave.T, start @ self.wave.T + self.phase
        still = np.abs(rate * length) < 1e-4
        safe = np.where(still, 1.0, rate)
        low, high = np.exp(1j * phase), np.exp(1j * (phase + rate * length))
        first = np.where(still, length * np.exp(1j * (phase + 0.5 * rate * length)), (high - low) / (1j * safe))
        second = np.where(still, 0.5 * length**2 * low, (high - low - 1j * safe * length * low) / (1j * safe) ** 2)
        turned = np.real(1j * first) @ (self.size[:, None] * self.wave)
        moved = np.real(1j * second) @ (self.size[:, None] * self.wave)
        turned, moved = (part - np.sum(part * way, axis=1, keepdims=True) * way for part in (turned, moved))
        return Rays(np.real(first) @ self.size, turned, moved + beyond[:, None] * turned)


@dataclass
class Sum:
    """A sum of contrasts, each times a factor."""

    parts: list[tuple[float, object]] = field(default_factory=list)

    def lines(self, start: np.ndarray, end: np.ndarray, beyond: np.ndarray) -> Rays:
        """As `Formula.lines`."""
        first, *others = (part.lines(start, end, beyond) * factor for factor, part in self.parts)
        for other in others:
            first = first + other
        return first
