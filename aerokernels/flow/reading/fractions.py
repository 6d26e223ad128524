"""The gas mixture of a file: fractions of species, from their arrays to the `Composition` of a field.

The quantities carried from cells to a mesh or a grid are the partial densities, density times mass fraction:
refractivities are additive in them, and averages of them remain averages.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerokernels.flow.composition import Composition
from aerokernels.flow.reading.dataset import Dataset, ReadError
from aerokernels.flow.reading.density import found_name, scalar_array
from aerokernels.flow.species import SPECIES_NAMES, molar_mass

# What precedes a formula in the names of arrays, by the quantity: mass fractions (OpenFOAM, SU2, CFX, Eilmer), partial
# densities, mole fractions.
WORDS = {
    "mass": ("", "y", "mass", "massfraction", "massfractionof", "mf", "massf", "massfrac"),
    "density": ("rho", "density", "partialdensity", "rhos"),
    "mole": ("x", "mole", "molefraction", "molef", "molefrac"),
}


@dataclass(frozen=True, eq=False)
class Fractions:
    """Mass fractions of the species in a file."""

    names: tuple[str, ...]  # chemical formulas
    blocks: list[np.ndarray]  # of each block, shape (species_count, value_count), at the places of the density
    said: str  # description of the arrays used

    def composition(self, partial: np.ndarray, ambient: np.ndarray) -> Composition:
        """Return the composition of a field from partial densities."""
        outside = ambient / ambient.sum()
        total = partial.sum(axis=0)
        empty = total <= 0.0
        shares = partial / np.where(empty, 1.0, total)
        shares[:, empty] = outside[:, None]
        inside = {name: np.array(own) for name, own in zip(self.names, shares, strict=True)}
        return Composition(inside, "mass", dict(zip(self.names, outside.tolist(), strict=True)))


def choose_fractions(path, dataset: Dataset, densities, given) -> Fractions | None:
    """Find the species of a file and their mass fractions, at the places of the densities.

    `given` is the option `species` of `read`. Fractions below 0, not finite or of a sum other than 1 are refused.
    """
    if given is None or given is False:
        return None
    basis, arrays = species_arrays(path, dataset.array_names(), given, dataset.grouped)
    blocks = []
    for block, (_, where) in zip(dataset.blocks, densities, strict=True):
        found = {name: scalar_array(path, block, name, where) for name in arrays.values()}
        if other := [(name, place) for name, (_, place) in found.items() if place != where]:
            fault = f"{other[0][0]} is given at {other[0][1]}s, the density at {where}s"
            raise ReadError(path, fault, "give both in the same places")
        shares = np.stack([own for own, _ in found.values()])
        blocks.append(mass_fractions(path, shares, where, arrays, basis, block.blank))
    return Fractions(tuple(arrays), blocks, mixture_in_words(basis, arrays))


def mixture_in_words(basis: str, arrays: Mapping[str, str]) -> str:
    """Describe the arrays used for the fractions of each species."""
    sources = ", ".join(name if name == array else f"{name} from {array!r}" for name, array in arrays.items())
    kind = "partial densities" if basis == "density" else f"{basis} fractions"
    return f"a mixture by {kind} of {sources}"


def species_arrays(path, names: list[str], given, grouped: bool = False) -> tuple[str, dict[str, str]]:
    """Return the basis, and the array of each species, from the available `names`; otherwise as `choose_fractions`."""
    basis = "mass"
    listed = ", ".join(names) or "none"
    if isinstance(given, Mapping):
        basis = given.get("basis", basis)
        if basis not in WORDS:
            raise ValueError(f"species: the basis of fractions is 'density', 'mass' or 'mole', got {basis!r}")
        stated = {name: array for name, array in given.items() if name != "basis"}
        for name, array in stated.items():
            molar_mass(name)
            if not isinstance(array, str):
                raise TypeError(f"species: {name} must name an array of the file, got {array!r}")
        arrays = {name: found_name(path, array, names, listed, grouped) for name, array in stated.items()}
    elif given is True or (isinstance(given, (list, tuple)) and all(isinstance(name, str) for name in given)):
        for name in given if given is not True else ():
            molar_mass(name)
        wanted = SPECIES_NAMES if given is True else tuple(given)
        basis, chosen = _by_usual_names(names, wanted, grouped)
        if given is not True and (lacking := [name for name in wanted if name not in chosen]):
            raise ReadError(path, f"no array is known for the mass fraction of {lacking[0]} (there are: {listed})",
                            f'name it: species = {{{lacking[0]} = "NAME", ...}}')  # fmt: skip
        arrays = {name: chosen[name] for name in wanted if name in chosen}
    else:
        raise TypeError(f"species must be True, formulas, or a mapping of formulas to arrays, got {given!r}")
    if not arrays:
        raise ReadError(path, f"no array is called by a species of {', '.join(SPECIES_NAMES)} (there are: {listed})",
                        'name them: species = {N2 = "NAME", ...}')  # fmt: skip
    return basis, arrays


def _by_usual_names(names: list[str], wanted: Sequence[str], grouped: bool) -> tuple[str, dict[str, str]]:
    """Return the basis and the array of each species that a file calls by its formula, as mass fractions if it has any.

    A lone letter is an atom or the electron only where there is a molecule too: "E" is mostly an energy.
    """
    keys = {_key(name, grouped): name for name in reversed(names)}
    for basis, words in WORDS.items():
        spelled = {formula: [word + own for word in words for own in _spellings(formula)] for formula in wanted}
        chosen = {
            formula: keys[next(filter(keys.__contains__, spellings))]
            for formula, spellings in spelled.items()
            if any(map(keys.__contains__, spellings))
        }
        if any(len(formula.rstrip("+-")) > 1 for formula in chosen):
            return basis, chosen
    return "mass", {}


def _key(name: str, grouped: bool) -> str:
    """Return an array's name in lower case, without brackets, units and punctuation, its charge as a word."""
    last = name.rsplit("/", 1)[-1] if grouped else name
    last = re.sub(r"\[[^\]]*\]|\([^)]*\)", "", last).strip().lower()
    sign = {"+": "plus", "-": "minus"}.get(last[-1:], "")
    return re.sub(r"[^a-z0-9]", "", last) + sign


def _spellings(formula: str) -> tuple[str, ...]:
    if formula == "e-":
        return "eminus", "em", "electron", "electrons", "e"
    plain = formula.rstrip("+").lower()
    return (plain + "plus", plain + "p") if formula.endswith("+") else (plain,)


def mass_fractions(
    path, shares: np.ndarray, where: str, arrays: Mapping[str, str], basis: str, blank: np.ndarray | None = None
) -> np.ndarray:
    """Return mass fractions of sum 1; blanked places, which nothing reads, get equal parts.

    `shares` are those that were read, shape (species_count, value_count), each at a "cell", "point" or "node".
    """
    names, said = list(arrays), ", ".join(arrays.values())
    if blank is None or len(blank) != shares.shape[1]:
        blank = np.zeros(shares.shape[1], bool)
    blank = np.asarray(blank, bool)
    total = shares.sum(axis=0)
    with np.errstate(invalid="ignore"):
        # Solvers' fractions deviate by a thousandth from a sum of 1, and below 0.
        if basis == "density":
            bad = ~((shares >= -1e-3 * total).all(axis=0) & (total > 0.0)) & ~blank
        else:
            bad = ~((shares >= -1e-3).all(axis=0) & (np.abs(total - 1.0) <= 1e-3)) & ~blank
    if bad.any():
        first = int(np.argmax(bad))
        own = ", ".join(f"{name} {float(share):.6g}" for name, share in zip(names, shares[:, first], strict=True))
        count = f"{int(bad.sum())} of {len(bad)}"
        raise ReadError(
            path,
            f"{said} do not add up to a whole in {count} {where}s: {where} {first} has {own}, "
            f"the sum {float(total[first]):.6g} instead of 1",
            f"name all species that are there (known are {', '.join(SPECIES_NAMES)}), or leave species out",
        )
    parts = np.where(blank, 1.0, np.maximum(shares, 0.0))
    if basis == "mole":
        parts *= np.array([molar_mass(name) for name in names])[:, None]
    return np.asarray(parts / parts.sum(axis=0))
