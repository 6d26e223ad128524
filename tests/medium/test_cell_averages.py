"""Cell averages on a uniform grid: what is ingested is what the interpolant averages to; shocks keep their place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels.medium import IndexField
from aerokernels.medium.spline import coefficients, node_values, weights

# Six Gauss points integrate cubic pieces exactly; half cells, so that no piece is straddled.
GAUSS, SHARE = np.polynomial.legendre.leggauss(6)


def averages_of_spline(values: np.ndarray, even: bool) -> np.ndarray:
    """Averages of the cubic spline through `values` over the cells centred on the inner nodes."""
    c = coefficients(values, "cubic", even)
    result = []
    for node in range(1, len(values) - 1):
        total = 0.0
        for cell, low in ((node - 1, 0.5), (node, 0.0)):
            value = weights("cubic", low + 0.25 * (GAUSS + 1.0))[0]
            total += 0.25 * SHARE @ (c[cell : cell + 4] @ value)
        result.append(total)
    return np.array(result)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 40), st.booleans(), st.integers(0, 10**6))
def test_the_cubic_spline_has_the_averages_it_was_given(count, even, seed):
    """Inner cells: their averages come back to rounding (condition number of the system below 10)."""
    data = np.random.default_rng(seed).uniform(-1.0, 1.0, count)
    values = node_values(data, "cubic", even)
    assert np.isfinite(values).all()
    assert averages_of_spline(values, even) == pytest.approx(data[1:-1], abs=1e-12)


def test_even_in_r():
    """Averages of 1 - r^2 over cells, the first from -h/2 to h/2, give the parabola at the nodes."""
    h = 0.1
    r = h * np.arange(12)
    average = 1.0 - r**2 - h**2 / 12.0
    assert node_values(average, "cubic", True) == pytest.approx(1.0 - r**2, abs=1e-13)


@pytest.mark.parametrize(("interpolation", "allowed"), [("cubic", 2e-3), ("linear", 0.03), ("monotone", 0.03)])
def test_a_shock_inside_a_cell_keeps_its_place(interpolation, allowed):
    """Set-up: a step of height J at any place between two nodes, line integral across it over 21 cells.

    Expected: J times the length behind the step. Samples at the nodes are off by up to J h / 2. Averages conserve the
    integral: what is left is the decay of the spline's ripple to the ends (0.43^10 = 2e-4 of J h), or for the others
    nothing but the share of the end cells, where the data are constant. Tolerances are in units of J h.
    """
    h, jump = 1e-4, 2.4e-4
    z = h * np.arange(21)
    worst_nodes = worst_average = 0.0
    for place in 10.0 * h + h * np.linspace(-0.49, 0.49, 9):
        average = jump * np.clip((z + 0.5 * h - place) / h, 0.0, 1.0)
        exact = jump * (z[-1] - place)
        line = np.c_[np.zeros((4000, 2)), z[-1] * (np.arange(4000) + 0.5) / 4000]
        for data, is_average in ((jump * (z > place), False), (average, True)):
            field = IndexField.from_samples(
                np.repeat(data[None], 4, axis=0),
                origin=(-1.5 * h, 0.0),
                spacing=(h, h),
                geometry="planar",
                interpolation=interpolation,
                cell_averages=is_average,
            )
            off = abs(field.contrast_at(line).mean() * z[-1] - exact) / (jump * h)
            if is_average:
                worst_average = max(worst_average, off)
            else:
                worst_nodes = max(worst_nodes, off)
    assert worst_nodes > 0.4
    assert worst_average < allowed
