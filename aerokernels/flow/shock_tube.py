"""The flow in a shock tube at one time as a density field: the exact solution of its Riemann problem."""

from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_choice, check_positive
from .exact_averages import piecewise_means
from .exact_field import DEFAULT_CELLS, LEAST_CELLS, ExactField, edges, rectangles, square_step
from .gas import GAMMA_AIR
from .riemann import GasState, Riemann, riemann

AXES = ("y", "z")


@dataclass(frozen=True)
class TubeAtTime:
    """The flow in a shock tube at one time after its diaphragm, at the origin, has burst.

    Attributes:
        riemann: The solution, with its relations.
        time: Time since the burst [s].
        axis: "y": left to right is along +y; "z": left to right is downstream, along -z.
        reference: Density of the gas on the right [kg/m3].
    """

    riemann: Riemann
    time: float
    axis: str
    reference: float

    @checked
    def density_ratio_at(self, y: Numbers, z: Numbers) -> np.ndarray:
        """Density over that of the gas on the right at (y, z) [m]."""
        place = np.asarray(y) if self.axis == "y" else -np.asarray(z)
        return self.riemann.density_at(place / self.time) / self.reference


@checked
def shock_tube(
    left: GasState,
    right: GasState,
    time: float,
    *,
    length: float,
    width: float | None = None,
    axis: str = "y",
    spacing: float | None = None,
    gamma: float = GAMMA_AIR,
) -> ExactField:
    """Return the exact flow in a shock tube at one time as a planar density field, with exact cell averages.

    The diaphragm was at the origin. Rays along z cross a tube along y, and run along a tube along z.

    Args:
        left: State of the gas on the left.
        right: State of the gas on the right; its density is the ambient one.
        time: Time since the diaphragm burst [s].
        length: Length of the tube [m], half of it to each side; the waves must not have reached the ends.
        width: Extent across the tube [m]; None takes a tenth of the length.
        axis: "y": left to right is along +y; "z": left to right is downstream, along -z.
        spacing: Greatest length of the cells along the tube [m]; None takes 1/200 of the length. There are 8 cells
            across the tube.
        gamma: Ratio of specific heats of both gases.

    Returns:
        The field; `solution.riemann` has pressure, speeds and densities of the waves.

    Raises:
        TypeError: A state that is not a GasState.
        ValueError: As for `riemann`; a quantity that is not positive; an unknown axis; a tube so short that a wave has
            left it (the message gives the least length).
    """
    solution = riemann(left, right, gamma=gamma)
    check_positive(time, "time")
    check_positive(length, "length")
    across = 0.1 * length if width is None else check_positive(width, "width")
    check_choice(axis, "axis", AXES)
    least = 2.0 * time * max(abs(speed) for speed in solution.breaks)
    if length < least:
        raise ValueError(
            f"length {length:g} m is too short: at {time:g} s the waves span {least:g} m about the diaphragm"
        )
    half = 0.5 * length
    along = edges(-half, half, square_step(half, spacing, DEFAULT_CELLS // 2))
    beside = np.linspace(-0.5 * across, 0.5 * across, LEAST_CELLS + 1)
    mesh = rectangles(along, beside) if axis == "y" else rectangles(beside, along)
    mean = piecewise_means(lambda x: solution.density_at(x / time), along, [time * speed for speed in solution.breaks])
    if axis == "y":
        density = np.repeat(mean[:, None], LEAST_CELLS, axis=1)
    else:
        density = np.repeat(mean[None, ::-1], LEAST_CELLS, axis=0)
    return ExactField(
        mesh,
        density,
        right.density,
        provenance=f"exact shock tube along {axis}, {time:g} s after the burst",
        solution=TubeAtTime(solution, float(time), axis, right.density),
    )
