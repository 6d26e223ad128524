r"""The Riemann problem of a perfect gas: two uniform states side by side, and the waves that spread between them.

Across the wave on either side the velocity changes by a function of the pressure p between the two waves,

    shock (p > pk)        f = (p - pk) sqrt(A / (p + B)),  A = 2 / ((g + 1) rhok),  B = (g - 1) / (g + 1) pk
    rarefaction           f = 2 ak / (g - 1) ((p / pk)^((g - 1) / (2 g)) - 1)

and p is the root of f_left + f_right + u_right - u_left = 0, a function that increases with p.

Reference: E. F. Toro, Riemann Solvers and Numerical Methods for Fluid Dynamics, 3rd ed., ch. 4.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive
from .gas import GAMMA_AIR, GAS_CONSTANT_AIR, check_gamma
from .shocks import bisect


@checked
@dataclass(frozen=True)
class GasState:
    """A uniform gas that moves along a tube.

    Attributes:
        density: [kg/m3].
        pressure: [Pa].
        velocity: Positive towards the right [m/s].
    """

    density: float
    pressure: float
    velocity: float = 0.0

    def __post_init__(self):
        """Check the numbers."""
        check_positive(self.density, "density")
        check_positive(self.pressure, "pressure")
        if not math.isfinite(self.velocity):
            raise ValueError(f"velocity must be finite, got {self.velocity!r}")

    def sound_speed(self, gamma: float = GAMMA_AIR) -> float:
        """Speed of sound [m/s]."""
        return math.sqrt(gamma * self.pressure / self.density)

    def temperature(self, gas_constant: float = GAS_CONSTANT_AIR) -> float:
        """Temperature [K] of a gas with a gas constant [J/(kg K)]."""
        return self.pressure / (self.density * gas_constant)


@dataclass(frozen=True)
class Riemann:
    """The exact solution as functions of position over time, xi = x / t [m/s]: up to six regions that grow with time.

    Attributes:
        left: State on the left.
        right: State on the right.
        gamma: Ratio of specific heats.
        pressure: Pressure between the two outer waves [Pa].
        velocity: Velocity of the contact between the two gases [m/s].
        left_density: Density between the left wave and the contact [kg/m3].
        right_density: Density between the contact and the right wave [kg/m3].
        left_wave: Speeds of the head and the tail of the left wave [m/s]; equal for a shock.
        right_wave: Speeds of the tail and the head of the right wave [m/s], in the order of xi; equal for a shock.
    """

    left: GasState
    right: GasState
    gamma: float
    pressure: float
    velocity: float
    left_density: float
    right_density: float
    left_wave: tuple[float, float]
    right_wave: tuple[float, float]

    @property
    def breaks(self) -> tuple[float, ...]:
        """Speeds at which the density jumps or has a kink, in order [m/s]."""
        return (*self.left_wave, self.velocity, *self.right_wave)

    @checked
    def density_at(self, speed: Numbers) -> np.ndarray:
        """Density [kg/m3] at xi = x / t [m/s]."""
        return self._select(speed, 0)

    @checked
    def velocity_at(self, speed: Numbers) -> np.ndarray:
        """Velocity [m/s] at xi = x / t [m/s]."""
        return self._select(speed, 1)

    @checked
    def pressure_at(self, speed: Numbers) -> np.ndarray:
        """Pressure [Pa] at xi = x / t [m/s]."""
        return self._select(speed, 2)

    def _select(self, speed, which: int) -> np.ndarray:
        xi = np.asarray(speed, dtype=np.float64)
        left = self._side(xi, self.left, 1.0, self.left_density, self.left_wave)[which]
        right = self._side(-xi, self.right, -1.0, self.right_density, tuple(-s for s in self.right_wave[::-1]))[which]
        return np.where(np.isnan(xi), np.nan, np.where(xi < self.velocity, left, right))

    def _side(self, xi, state: GasState, sign: float, density: float, wave) -> tuple[np.ndarray, ...]:
        """Return density, velocity and pressure on one side, mirrored if necessary so that its wave runs left."""
        first, last = wave
        sound, own = state.sound_speed(self.gamma), sign * state.velocity
        # In a rarefaction the sound speed is linear in xi.
        inside = np.clip(xi, first, last)
        share = 2.0 / (self.gamma + 1.0) + (self.gamma - 1.0) / ((self.gamma + 1.0) * sound) * (own - inside)
        speed = 2.0 / (self.gamma + 1.0) * (sound + 0.5 * (self.gamma - 1.0) * own + inside)
        fan = (
            state.density * share ** (2.0 / (self.gamma - 1.0)),
            speed,
            state.pressure * share ** (2.0 * self.gamma / (self.gamma - 1.0)),
        )
        before = (state.density, own, state.pressure)
        after = (density, sign * self.velocity, self.pressure)
        found = [np.where(xi < first, b, np.where(xi < last, f, a)) for b, f, a in zip(before, fan, after, strict=True)]
        return found[0], sign * found[1], found[2]


@checked
def riemann(left: GasState, right: GasState, *, gamma: float = GAMMA_AIR) -> Riemann:
    """Return the exact solution of the Riemann problem, such as that of a shock tube whose diaphragm bursts.

    Pressure and speeds are accurate to 1e-13.

    Args:
        left: State on the left.
        right: State on the right.
        gamma: Ratio of specific heats of both gases.

    Raises:
        TypeError: A state that is not a GasState.
        ValueError: Gamma not above 1, or states that separate so fast that a vacuum opens between them (the message
            gives the limit).
    """
    for name, state in (("left", left), ("right", right)):
        if not isinstance(state, GasState):
            raise TypeError(
                f"{name} must be a GasState, got {type(state).__name__}: GasState(density, pressure, velocity)"
            )
    check_gamma(gamma)
    apart = right.velocity - left.velocity
    limit = 2.0 / (gamma - 1.0) * (left.sound_speed(gamma) + right.sound_speed(gamma))
    if apart >= limit:
        raise ValueError(
            f"vacuum opens between the gases: they part at {apart:g} m/s, which must be below {limit:g} m/s"
        )

    def balance(logarithm: float) -> float:
        pressure = math.exp(logarithm)
        return _change(pressure, left, gamma) + _change(pressure, right, gamma) + apart

    low = high = math.log(math.sqrt(left.pressure * right.pressure))
    while balance(low) >= 0.0:
        low -= 2.0
    while balance(high) < 0.0:
        high += 2.0
    pressure = math.exp(bisect(balance, low, high))
    # The contact's speed is computed from the side with the smaller change, which loses fewer digits.
    changes = _change(pressure, left, gamma), _change(pressure, right, gamma)
    if abs(changes[0]) < abs(changes[1]):
        velocity = left.velocity - changes[0]
    else:
        velocity = right.velocity + changes[1]
    left_density, left_wave = _wave(pressure, velocity, left, 1.0, gamma)
    right_density, right_wave = _wave(pressure, velocity, right, -1.0, gamma)
    return Riemann(
        left=left,
        right=right,
        gamma=float(gamma),
        pressure=pressure,
        velocity=velocity,
        left_density=left_density,
        right_density=right_density,
        left_wave=left_wave,
        right_wave=(right_wave[1], right_wave[0]),
    )


def _change(pressure: float, state: GasState, gamma: float) -> float:
    """Return by how much the velocity falls across the wave on one side, seen from the gas ahead of the wave."""
    if pressure > state.pressure:
        a, b = 2.0 / ((gamma + 1.0) * state.density), (gamma - 1.0) / (gamma + 1.0) * state.pressure
        return (pressure - state.pressure) * math.sqrt(a / (pressure + b))
    exponent = 0.5 * (gamma - 1.0) / gamma
    return 2.0 * state.sound_speed(gamma) / (gamma - 1.0) * math.expm1(exponent * math.log(pressure / state.pressure))


def _wave(pressure: float, velocity: float, state: GasState, sign: float, gamma: float):
    """Return the density behind the wave on one side, and the speeds of its head and tail; sign 1: the left wave."""
    ratio, sound = pressure / state.pressure, state.sound_speed(gamma)
    if ratio > 1.0:
        share = (gamma - 1.0) / (gamma + 1.0)
        density = state.density * (ratio + share) / (share * ratio + 1.0)
        front = state.velocity - sign * sound * math.sqrt(0.5 * ((gamma + 1.0) * ratio + gamma - 1.0) / gamma)
        return density, (front, front)
    density = state.density * ratio ** (1.0 / gamma)
    behind = sound * ratio ** (0.5 * (gamma - 1.0) / gamma)
    head, tail = state.velocity - sign * sound, velocity - sign * behind
    # Rounding must not exchange head and tail of a weak wave.
    return density, (head, max(head, tail) if sign > 0.0 else min(head, tail))
