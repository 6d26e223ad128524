"""Absorption coefficients of gases from their cross-sections, for `IndexField.with_absorption`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.composition import Composition
from aerokernels.flow.species import AVOGADRO, molar_mass
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import check_path, check_wavelength
from aerokernels.inputs.kinds import wrong_kind


@checked
def absorption_coefficient(density: Any, composition: Composition, cross_sections: Mapping[str, Any]) -> np.ndarray:
    """Return the absorption coefficient of a mixture [1/m]: the sum of number density times cross-section.

    Args:
        density: [kg/m3], any shape.
        composition: The mixture, of numbers or of arrays with one entry for each density.
        cross_sections: Cross-section [m2] of a molecule by species, at the light's wavelength: a number, or an array
            with one entry for each density, as where the temperature varies. Other species are taken as transparent.

    Returns:
        An array of the densities' shape.

    Raises:
        TypeError: `composition` is no Composition.
        ValueError: A species that the composition lacks, or a cross-section that is negative or not finite.

    Example:
        >>> moist = Composition({"N2": 0.78, "O2": 0.21, "H2O": 0.01})
        >>> round(float(absorption_coefficient(1.2, moist, {"H2O": 1e-26})), 6)
        0.002509
    """
    if not isinstance(composition, Composition):
        raise wrong_kind(composition, "composition", "a Composition")
    density = np.asarray(density, dtype=np.float64)
    total = np.zeros(density.shape)
    shares = composition.mass_fractions
    for name, section in cross_sections.items():
        if name not in shares:
            raise ValueError(f"the composition has no {name}: it has {', '.join(shares)}")
        area = np.asarray(section, dtype=np.float64)
        if not (np.isfinite(area).all() and (area >= 0.0).all()):
            raise ValueError(f"the cross-section of {name} must be finite and not negative [m2], got {section!r}")
        share = np.asarray(shares[name])
        share = share.reshape(density.shape) if share.size == density.size and share.ndim else share
        total += density * share * (AVOGADRO / molar_mass(name)) * area
    return total


@checked
def cross_section(path: str | Path, wavelength: float) -> float:
    """Return a cross-section [m2] at a vacuum wavelength [m] from a file of two columns, as HAPI and HITRAN write it.

    The columns are the wave number [1/cm], rising, and the cross-section [cm2 per molecule]; lines that begin with
    "#" are passed over. Between the rows it is interpolated linearly.

    Raises:
        ValueError: A file that is not such a table, or a wavelength outside of it.
    """
    file, wave_number = check_path(path, "path"), 1e-2 / check_wavelength(wavelength)
    try:
        rows = np.loadtxt(file, ndmin=2, usecols=(0, 1))
    except (OSError, ValueError, IndexError) as fault:
        raise ValueError(f"{file} is no table of wave numbers [1/cm] and cross-sections [cm2]: {fault}") from None
    if len(rows) < 2 or not (np.isfinite(rows).all() and (np.diff(rows[:, 0]) > 0.0).all() and (rows[:, 1] >= 0).all()):
        raise ValueError(f"{file} needs two or more rows of rising wave numbers and cross-sections of at least 0")
    if not rows[0, 0] <= wave_number <= rows[-1, 0]:
        raise ValueError(
            f"{file} has wave numbers of {rows[0, 0]:g} to {rows[-1, 0]:g} per cm, and {wavelength:g} m is "
            f"{wave_number:g} per cm"
        )
    return float(1e-4 * np.interp(wave_number, rows[:, 0], rows[:, 1]))
