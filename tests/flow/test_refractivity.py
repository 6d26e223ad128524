"""Density to index."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerokernels import flow

K = flow.gladstone_dale_constant(905e-9)
DENSITY = st.floats(1e-6, 20.0)


def test_gladstone_dale_constant_at_the_lasers_wavelength():
    """Eq 2 by hand at 0.905 um: 2.23e-4 (1 + 7.52e-3 / 0.819025) = 2.250475e-4 m3/kg, seven digits."""
    assert abs(K - 2.250475e-4) < 0.5e-10


@given(DENSITY)
def test_exact_minus_linear(density):
    """Reading 1: Lorentz-Lorenz minus Gladstone-Dale is e^2/6 + O(e^3), e = K rho; 1.3e-8 at 1.225 kg/m3.

    The next term of the series is 2 e^3/9 or less in size. Rounding: e times a few 1e-16.
    """
    e = K * density
    difference = flow.index_contrast(density, 0.0, K, "lorentz-lorenz") - flow.index_contrast(density, 0.0, K)
    assert abs(difference - e**2 / 6.0) < e**3 + 1e-15 * e


@given(DENSITY, st.floats(1e-6, 20.0))
def test_lorentz_lorenz_is_satisfied_in_exact_arithmetic(density, ambient):
    """n^2 (1 - a) = 1 + 2 a with n = 1 + refractivity, in fractions: no rounding in the check itself."""
    value = 1 + Fraction(float(flow.index_contrast(density, 0.0, K, "lorentz-lorenz")))
    a = Fraction(2, 3) * Fraction(K) * Fraction(density)
    n_squared = (1 + 2 * a) / (1 - a)
    assert abs(float(value**2 - n_squared)) < 1e-15 * float(n_squared - 1)
    # The contrast is the difference of two refractivities, up to their rounding ...
    contrast = float(flow.index_contrast(density, ambient, K, "lorentz-lorenz"))
    parts = [float(flow.index_contrast(rho, 0.0, K, "lorentz-lorenz")) for rho in (density, ambient)]
    assert abs(contrast - (parts[0] - parts[1])) < 2e-15 * max(parts)


@pytest.mark.parametrize("relation", flow.RELATIONS)
def test_contrast_keeps_its_digits_where_the_density_hardly_differs(relation):
    """Set-up: rho = 1.225 (1 + 2^-40). A difference of indices near 1 would keep 2 digits of the contrast 2.5e-16.

    Expected: dn/drho times the exact density difference; dn/drho = K for the linear relation, K (1 + K rho / 3) for the
    exact one up to (K rho)^2 < 1e-7.
    """
    step = 1.225 * (1 + 2.0**-40) - 1.225
    contrast = float(flow.index_contrast(1.225 + step, 1.225, K, relation))
    slope = K if relation == "gladstone-dale" else K * (1.0 + K * 1.225 / 3.0)
    assert abs(contrast / (slope * step) - 1.0) < 1e-7


@pytest.mark.parametrize("wavelength", [905.0, 0.905, 905e-6, 0.0, -905e-9, math.nan, 100e-9])
def test_wavelengths_in_the_wrong_unit_are_refused(wavelength):
    with pytest.raises(ValueError, match=r"wavelength .* give metres"):
        flow.gladstone_dale_constant(wavelength)


def test_unknown_relation_and_bad_constant():
    with pytest.raises(ValueError, match="gladstone-dale, lorentz-lorenz"):
        flow.index_contrast(1.0, 0.0, K, "linear")
    with pytest.raises(ValueError, match="must be positive"):
        flow.index_contrast(1.0, 0.0, -K)


def test_densities_without_an_index_are_refused():
    """Above K rho = 1.5 the Lorentz-Lorenz relation has no index: NaN came back."""
    assert flow.index_contrast(100.0, 0.0, 1e-2, "lorentz-lorenz") > 1.0
    with pytest.raises(ValueError, match=r"K times density is 1\.5 or more, got 4"):
        flow.index_contrast(np.array([100.0, 400.0]), 0.0, 1e-2, "lorentz-lorenz")
