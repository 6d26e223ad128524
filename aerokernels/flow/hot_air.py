"""The composition of dry air in chemical equilibrium: dissociated and singly ionised, 200 to 15000 K.

Concentrations follow from the Gibbs energies g of the species, c = p0 / (R T) exp(-g / (R T) + sum over elements of
count times potential), where the potentials conserve nitrogen and oxygen and make the charges equal. Gibbs energies:
B. J. McBride, M. J. Zehe and S. Gordon, NASA/TP-2002-211556, polynomials for 200 to 1000, to 6000 and to 20000 K.
"""

from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.composition import Composition
from aerokernels.flow.species import HOTTEST as HOTTEST_MOLECULES
from aerokernels.flow.species import molar_mass
from aerokernels.inputs.arguments import checked

COOLEST, HOTTEST = 200.0, 15e3  # [K]; above, atoms lose second electrons
# Mole fractions of dry air at rest; argon and carbon dioxide are taken as inert.
NITROGEN, OXYGEN, INERT = 0.78084, 0.20946, {"Ar": 0.00934, "CO2": 0.00036}
GAS_CONSTANT, STANDARD_PRESSURE = 8.314462618, 1e5  # [J/(mol K)], [Pa]
# Nitrogen and oxygen atoms in each species, in the order of the file of coefficients; ions have lost one electron.
ATOMS = {
    "N": (1, 0), "O": (0, 1), "N2": (2, 0), "O2": (0, 2), "NO": (1, 1),
    "N+": (1, 0), "O+": (0, 1), "N2+": (2, 0), "O2+": (0, 2), "NO+": (1, 1), "e-": (0, 0),
}  # fmt: skip
RANGES = (1000.0, 6000.0)
_DATA = Path(__file__).parent / "data" / "nasa9_air.txt"


@checked
def equilibrium_air(
    density=None, temperature=None, *, pressure=None, ambient: dict[str, float] | None = None
) -> Composition:
    """Return the composition of dry air in chemical equilibrium, for `index_field(composition=...)`.

    Give the density or the pressure, and the temperature; numbers, or arrays with one entry for each density of a
    field. Species are N2, O2, NO, N, O, their ions and electrons, and Ar and CO2,
    which do not react.

    Args:
        density: [kg/m3].
        temperature: [K], 200 to 15000.
        pressure: [Pa].
        ambient: Mole fractions of the gas around the field; None is dry air at rest.

    Raises:
        TypeError: No temperature, or neither or both of density and pressure.
        ValueError: A temperature out of range, a density or pressure that is not positive, or other shapes.

    Example:
        >>> hot = equilibrium_air(density=0.01, temperature=6000.0)
        >>> round(hot.fractions["N2"], 3), round(hot.fractions["O"], 3)
        (0.608, 0.232)
    """
    if temperature is None or (density is None) == (pressure is None):
        raise TypeError("equilibrium air needs the temperature [K] and either density [kg/m3] or pressure [Pa]")
    which, state = ("density", density) if pressure is None else ("pressure", pressure)
    try:
        amount, heat = np.broadcast_arrays(np.asarray(state, np.float64), np.asarray(temperature, np.float64))
    except ValueError:
        raise ValueError(
            f"{which} has the shape {np.shape(state)}, temperature {np.shape(temperature)}: give one for each place"
        ) from None
    if not (np.isfinite(amount).all() and (amount > 0.0).all()):
        raise ValueError(f"{which} must be positive and finite everywhere")
    if not ((heat >= COOLEST) & (heat <= HOTTEST)).all():
        worst = heat.ravel()[np.argmax(np.abs(heat.ravel() - 7600.0))]
        raise ValueError(
            f"temperature {worst:g} K is outside {COOLEST:g} to {HOTTEST:g} K, where the equilibrium of air is known"
        )
    cold = {"N2": NITROGEN, "O2": OXYGEN, **INERT}
    mass = sum(share * molar_mass(name) for name, share in cold.items())
    total = amount.ravel() / mass if pressure is None else amount.ravel() / (GAS_CONSTANT * heat.ravel())
    own = _concentrations(total, heat.ravel(), pressure is not None)
    weights = {name: (molar_mass(name) * part).reshape(heat.shape) for name, part in own.items()}
    sums = sum(weights.values())
    fractions: dict[str, Any] = {name: weight / sums for name, weight in weights.items()}
    if heat.ndim == 0:
        fractions = {name: float(share) for name, share in fractions.items()}
    around = ambient or cold
    amounts = {name: share * molar_mass(name) for name, share in around.items()}
    outside = {name: share / sum(amounts.values()) for name, share in amounts.items()}
    return Composition(fractions, "mass", outside, np.minimum(heat, HOTTEST_MOLECULES))


def _concentrations(total: np.ndarray, temperature: np.ndarray, by_pressure: bool) -> dict[str, np.ndarray]:
    """Return the concentrations of the species [mol/m3].

    `total` is that of the undissociated air, or, `by_pressure`, of all particles.
    """
    names = list(ATOMS)
    counts = np.array([ATOMS[name] for name in names], float)  # (species, 2)
    ions, electron = np.array([name.endswith("+") for name in names]), names.index("e-")
    base = np.log(STANDARD_PRESSURE / (GAS_CONSTANT * temperature)) - _gibbs(temperature)
    amount, inert = np.log(total), sum(INERT.values())
    # Potentials of N and O, at first those of air without reactions or of atoms alone, whichever are less.
    potential = np.empty((2, len(total)))
    for element, (atom, molecule, share) in enumerate((("N", "N2", NITROGEN), ("O", "O2", OXYGEN))):
        of_atoms = amount + np.log(2.0 * share) - base[names.index(atom)]
        of_molecules = 0.5 * (amount + np.log(share) - base[names.index(molecule)])
        potential[element] = np.minimum(of_atoms, of_molecules)
    air = amount.copy()
    for _ in range(200):
        log = base + counts @ potential
        charge = 0.5 * (np.logaddexp.reduce(log[ions]) - log[electron])  # that of an electron
        log[ions] -= charge
        log[electron] += charge
        part = np.exp(log)
        # Newton's method for the amounts of both elements and, given the pressure, of the air; ions follow electrons.
        needed = np.exp(air) * 2.0 * np.array([NITROGEN, OXYGEN])[:, None]
        have = counts.T @ part
        slope = np.einsum("si,sn,sj->nij", counts, part, counts)
        lost = counts[ions].T @ part[ions]
        slope -= np.einsum("in,jn->nij", lost, lost) / (2.0 * np.maximum(part[electron], 1e-300))[:, None, None]
        if by_pressure:
            particles = part.sum(axis=0) + inert * np.exp(air)
            matrix = np.zeros((len(total), 3, 3))
            matrix[:, :2, :2] = slope
            matrix[:, :2, 2] = -needed.T
            matrix[:, 2, :2] = have.T
            matrix[:, 2, 2] = inert * np.exp(air)
            residual = np.stack([needed[0] - have[0], needed[1] - have[1], total - particles], axis=1)
        else:
            matrix, residual = slope, (needed - have).T
        step = np.linalg.solve(matrix, residual[..., None])[..., 0]
        step *= np.minimum(1.0, 2.0 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        potential += step[:, :2].T
        if by_pressure:
            air += step[:, 2]
        if np.abs(step).max() < 1e-10:
            break
    return dict(zip(names, part, strict=True)) | {name: share * np.exp(air) for name, share in INERT.items()}


def _gibbs(temperature: np.ndarray) -> np.ndarray:
    """Return g / (R T) of the species at the standard pressure, shape (species, n)."""
    t, logarithm = temperature, np.log(temperature)
    terms = np.stack([
        -0.5 / t**2, (1.0 + logarithm) / t, 1.0 - logarithm, -0.5 * t, -(t**2) / 6.0, -(t**3) / 12.0, -(t**4) / 20.0,
        1.0 / t, np.full_like(t, -1.0),
    ])  # fmt: skip
    coefficients = np.loadtxt(_DATA, usecols=range(1, 10)).reshape(len(ATOMS), len(RANGES) + 1, 9)
    return np.einsum("snk,kn->sn", coefficients[:, np.searchsorted(RANGES, t)], terms)
