"""Refractivity and index contrast from density.

    Lorentz-Lorenz (the paper's eq 1):  (n^2 - 1) / (n^2 + 2) = 2/3 K rho
    Gladstone-Dale (eq 3):              n = 1 + K rho                     the linear limit, lower by (K rho)^2 / 6
    K (eq 2):                           K = 2.23e-4 (1 + 7.52e-3 / lambda^2) m3/kg, lambda in um

A pulse travels by the group index n_g = n - lambda dn/dlambda. Dispersion formulas are functions of s = 1 / lambda^2:

    n_g = n + 2 s dn/ds,    K_g = K + 2 s dK/ds

K_g is called the group constant. In the linear form n_g = 1 + K_g rho.

Results are refractivities n - 1 or contrasts n - n_ambient, and no step subtracts numbers near 1: at 1 kg/m3 the index
differs from 1 by only 2e-4.
"""

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from ..inputs.wavelength import check_wavelength

RELATIONS = ("gladstone-dale", "lorentz-lorenz")
# Eq 2 was fitted in the visible; below this wavelength air absorbs and its index rises faster.
SHORTEST_WAVELENGTH = 200e-9
# Gases have constants from xenon's 1.2e-4 to hydrogen's 1.6e-3 m3/kg; values far outside are in another unit.
LEAST_CONSTANT, GREATEST_CONSTANT = 1e-5, 1e-2


@checked
def gladstone_dale_constant(wavelength: float, *, group: bool = False) -> float:
    """Return the Gladstone-Dale constant of air [m3/kg] at a vacuum wavelength [m], the paper's eq 2.

    At 905 nm it is 2.250475e-4, 0.46 % above Ciddor's dry air.

    Args:
        wavelength: [m].
        group: Return the group constant.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength outside 0.2 to 20 um.
    """
    wavelength = check_wavelength(wavelength)
    if wavelength < SHORTEST_WAVELENGTH:
        raise ValueError(
            f"wavelength {wavelength:g} m is shorter than the {SHORTEST_WAVELENGTH * 1e9:g} nm down to which the "
            "Gladstone-Dale constant's formula holds: give metres, 905e-9 for 905 nm, or the constant itself"
        )
    micrometres = wavelength * 1e6
    return 2.23e-4 * (1.0 + (3.0 if group else 1.0) * 7.52e-3 / micrometres**2)


@checked
def refractivity(density: float | np.ndarray, gladstone_dale: float | np.ndarray, relation: str = "gladstone-dale"):
    """Return the refractivity n - 1 at a density.

    Args:
        density: [kg/m3], any shape.
        gladstone_dale: Gladstone-Dale constant K [m3/kg], one number or one for each density.
        relation: "gladstone-dale" or "lorentz-lorenz".

    Raises:
        ValueError: An unknown relation, or a constant outside 1e-5 to 1e-2 m3/kg.
    """
    return index_contrast(density, 0.0, gladstone_dale, relation)


@checked
def index_contrast(
    density: float | np.ndarray,
    ambient_density: float,
    gladstone_dale: float | np.ndarray,
    relation: str = "gladstone-dale",
):
    """Return the contrast n - n_ambient of densities of any shape and an ambient density [kg/m3].

    With a = 2/3 K rho, Lorentz-Lorenz gives n^2 - 1 = q = 3 a / (1 - a), so the contrast is
    (q - q_ambient) / (n + n_ambient) with q - q_ambient = 3 (a - a_ambient) / ((1 - a) (1 - a_ambient)). The only
    difference taken is that of the densities.

    Raises:
        ValueError: An unknown relation, a constant outside 1e-5 to 1e-2 m3/kg, or densities for which Lorentz-Lorenz
            has no solution.
    """
    _check(gladstone_dale, relation)
    density = np.asarray(density, dtype=np.float64)
    difference = density - ambient_density
    if relation == "gladstone-dale":
        if np.ndim(difference) and np.ndim(gladstone_dale) == 0:
            difference *= gladstone_dale
            return difference
        return gladstone_dale * difference
    inside, outside = 1.0 - 2.0 / 3.0 * gladstone_dale * density, 1.0 - 2.0 / 3.0 * gladstone_dale * ambient_density
    if np.any(inside <= 0.0) or np.any(outside <= 0.0):
        greatest = float(np.max(gladstone_dale * np.maximum(density, ambient_density)))
        raise ValueError(
            f"Lorentz-Lorenz has no index where K times density is 1.5 or more, got {greatest:.3g}: no gas is so dense"
        )
    difference_of_squares = 2.0 * gladstone_dale * difference / (inside * outside)
    index = np.sqrt(1.0 + 2.0 * gladstone_dale * density / inside)
    ambient_index = np.sqrt(1.0 + 2.0 * gladstone_dale * ambient_density / outside)
    return difference_of_squares / (index + ambient_index)


def group_refractivity(density, gladstone_dale, group_constant, relation: str):
    """Return n_g - 1 at densities [kg/m3], from K and the group constant [m3/kg], all of them arrays or numbers.

    n depends on the wavelength through K alone: n_g = n + (K_g - K) dn/dK, and by Lorentz-Lorenz, with a = 2/3 K rho,
    dn/dK = rho / (n (1 - a)^2).
    """
    if relation == "gladstone-dale":
        return group_constant * density
    excess = index_contrast(density, 0.0, gladstone_dale, relation)
    slope = density / ((1.0 + excess) * (1.0 - 2.0 / 3.0 * gladstone_dale * density) ** 2)
    return excess + (group_constant - gladstone_dale) * slope


def _check(gladstone_dale: float | np.ndarray, relation: str) -> None:
    check_choice(relation, "relation", RELATIONS)
    if not (np.size(gladstone_dale) and np.isfinite(gladstone_dale).all() and np.greater(gladstone_dale, 0.0).all()):
        raise ValueError(f"the Gladstone-Dale constant must be positive and finite, got {gladstone_dale!r} m3/kg")
    if np.min(gladstone_dale) < LEAST_CONSTANT or np.max(gladstone_dale) > GREATEST_CONSTANT:
        raise ValueError(
            f"a Gladstone-Dale constant of {np.max(gladstone_dale):g} m3/kg is outside the range of gases "
            f"({LEAST_CONSTANT:g} to {GREATEST_CONSTANT:g} m3/kg): air has 2.25e-4 m3/kg, which is 0.225 cm3/g"
        )
