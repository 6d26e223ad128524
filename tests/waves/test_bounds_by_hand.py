"""Bounds of a field's derivatives from its coefficients, written out over whole arrays."""

import math

import numpy as np
import pytest

from aerokernels import Disc, IndexField
from aerokernels.pupils import Pupil
from aerokernels.waves import bounds

WAVELENGTH = 905e-9
WAVE_NUMBER = 2.0 * math.pi / WAVELENGTH


def uneven_air(geometry: str, amplitude: float) -> IndexField:
    """Smooth noise over about 10 mm across and 25 mm along, off the origin, cells of unequal sides."""
    shape, spacing, origin = (21, 23, 16), (5e-4, 4.5e-4, 1.6e-3), (-5e-3, -5e-3, 2e-3)
    if geometry != "volume":
        shape, spacing, origin = shape[1:], spacing[1:], origin[1:]
    if geometry == "axisymmetric":
        origin = (0.0, origin[1])
    place = np.meshgrid(*(np.arange(n) / 4.0 for n in shape), indexing="ij")
    draw = np.random.default_rng(6)
    samples = sum(np.cos(sum(draw.normal() * one for one in place) + draw.uniform(0.0, 6.0)) for _ in range(6))
    samples = samples * np.sin(np.pi * np.arange(shape[-1]) / (shape[-1] - 1)) ** 2 + 3.0
    return IndexField.from_samples(amplitude * samples, origin=origin, spacing=spacing, geometry=geometry)


def ranges(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value in each plane across the last axis."""
    flat = values.reshape(-1, values.shape[-1])
    return flat.min(axis=0), flat.max(axis=0)


def bound_by_hand(field: IndexField, pupil: Pupil, sign: float) -> tuple[float, float, float]:
    """Bound of the change, of the curvature, and the length, by the module's formulas."""
    grid, round_about = field.samples, field.geometry == "axisymmetric"
    h, n = grid.spacing, grid.coefficients.shape[-1]
    slant = pupil.reach * math.sqrt(1.0 - pupil.normal[2] ** 2)
    distance = sign * (grid.origin[-1] + h[-1] * (np.arange(n) - 1) - pupil.center[2]) + slant
    length = distance.max() + pupil.reach
    wide = pupil.reach + 4.0 * math.sqrt(WAVELENGTH * length)
    parts = []
    for axis, middle in enumerate(pupil.center[3 - grid.samples.ndim : 2]):
        low, high = (middle - wide, middle + wide) if not round_about else (0.0, math.hypot(*pupil.center[:2]) + wide)
        parts.append(
            slice(math.floor((low - grid.origin[axis]) / h[axis]), math.ceil((high - grid.origin[axis]) / h[axis]) + 3)
        )
    c = grid.coefficients[tuple(parts)][..., distance > -2.0 * h[-1]]
    distance = np.maximum(distance[distance > -2.0 * h[-1]], 0.0)
    scale, ways, steps = h[-1] / grid.ambient_index, 2.0 if round_about else 1.0, h[:-1, None]
    first = [ranges(np.diff(c, axis=axis)) for axis in range(c.ndim - 1)]
    steep = [np.maximum(high, -low) if round_about else 0.5 * (high - low) for low, high in first]
    turn = scale * np.sqrt(sum((one / step) ** 2 for one, step in zip(steep, steps, strict=True))).sum()
    second, fourth = (
        [np.abs(np.diff(c, order, axis=axis)).reshape(-1, c.shape[-1]).max(axis=0) for axis in range(c.ndim - 1)]
        for order in (2, 4)
    )
    curving = ways * sum(one / step**2 for one, step in zip(second, steps, strict=True))
    curvature = scale * float(distance @ curving)
    rest = 2.0 * WAVE_NUMBER * length * turn**2 + curvature
    if rest > 0.1:
        curvature = change = math.inf
    else:
        share = scale / (4.0 * WAVE_NUMBER)
        diffraction = share * float(distance**2 @ curving) * 4.0 * ways * len(steps) / steps.min() ** 2
        if diffraction > 0.25 * rest and rest + diffraction > 5e-3:
            root = ways * sum(np.sqrt(one) / step**2 for one, step in zip(fourth, steps, strict=True))
            diffraction = share * float((distance * root) @ (distance * root))
        change = rest + diffraction
    if change > 5e-3:
        low, high = ranges(c)
        phase = 0.5 * scale * WAVE_NUMBER * float((high - low).sum())
        change = min(change, phase**2) if phase**2 <= 0.1 else change
    return change, curvature, length


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("amplitude", [3e-10, 3e-9, 1e-8, 6e-8, 3e-7, 3e-6])
@pytest.mark.parametrize("place", [-2e-3, 9e-3])
def test_the_bound_is_that_of_differences_of_coefficients(geometry: str, sign: float, amplitude: float, place: float):
    """A slanted pupil before the air or in it; from air whose bounds are not refined to air that proves nothing."""
    field = uneven_air(geometry, amplitude)
    low, high = field.box
    center = (3e-4, -4e-4, float(low[2]) + place if sign > 0.0 else float(high[2]) - place)
    pupil = Disc(1.2e-3, center, (0.1, 0.05, sign))
    found = bounds._along_z(field, field.samples, pupil, sign, WAVE_NUMBER)
    change, curvature, length = bound_by_hand(field, pupil, sign)
    assert found.distance == pytest.approx(length, rel=1e-12, abs=0.0)
    assert found.curvature == pytest.approx(curvature, rel=1e-4, abs=0.0)
    assert found.change == pytest.approx(change, rel=1e-4, abs=0.0)


@pytest.mark.parametrize("rows", [1 << 16, 300])
def test_bounds_do_not_depend_on_parts(monkeypatch: pytest.MonkeyPatch, rows: int):
    """Coefficients are processed a few rows at a time, with as many more as differences need."""
    field = uneven_air("volume", 1e-8)
    pupil = Disc(1.2e-3, (3e-4, -4e-4, 0.0))
    whole = bounds._along_z(field, field.samples, pupil, 1.0, WAVE_NUMBER)
    monkeypatch.setattr(bounds, "PART_SIZE", rows)
    assert bounds._along_z(field, field.samples, pupil, 1.0, WAVE_NUMBER) == whole
    values = np.random.default_rng(2).normal(size=(17, 6, 5))
    for order in (0, 2, 4):
        parts = list(bounds._parts(values, order))
        assert all(one.dtype == np.float32 for one in parts)
        together = np.concatenate([np.diff(one, order, axis=0) for one in parts])
        np.testing.assert_allclose(together, np.diff(values - values[0, 0], order, axis=0), atol=1e-5)
    assert len(list(bounds._parts(values, 2))) == (1 if rows > 1000 else 2)


def test_extremes_of_planes():
    draw = np.random.default_rng(3)
    for length in (3, 128, 129):
        for lines in (1, 2, 3, 5, 8):
            values = draw.normal(size=(lines, 2, length))
            low, high = ranges(values)
            np.testing.assert_array_equal(bounds._over(np.maximum, values), high)
            np.testing.assert_array_equal(bounds._over(np.minimum, values), low)
            np.testing.assert_array_equal(bounds._greatest(values.copy()), np.maximum(high, -low))
    np.testing.assert_array_equal(bounds._greatest(np.zeros((0, 4))), np.zeros(4))
    values = draw.normal(size=(5, 6, 7))
    for axis in (0, 1):
        for order in (1, 2, 4):
            np.testing.assert_allclose(bounds._differences(values, axis, order), np.diff(values, order, axis=axis))


def test_the_range_of_all_planes_unless_a_few_lines_show_that_it_is_too_much():
    values = np.random.default_rng(4).normal(size=(9, 7, 6))
    low, high = ranges(values)
    whole = float((high - low).sum())
    assert bounds._spread(values, whole) == pytest.approx(whole, rel=1e-6, abs=0.0)
    few_low, few_high = ranges(values[::4, ::3])
    few = float((few_high - few_low).sum())
    assert bounds._spread(values, 1.001 * few) == pytest.approx(whole, rel=1e-6, abs=0.0)
    assert bounds._spread(values, 0.999 * few) == math.inf
    assert bounds._spread(values[:1], 1e9) < whole


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_coefficients_about_a_pupils_light_or_none_where_it_may_leave_the_box(geometry: str):
    """A point in cell i depends on coefficients i to i + 3; the box's own faces are still in it."""
    field = uneven_air(geometry, 1e-8)
    grid = field.samples
    for x, y, wide in (
        (3e-4, -4e-4, 2e-3),
        (-1e-3, 1.1e-3, 3.3e-3),
        (0.0, 0.0, 4.85e-3),
        (0.0, 0.0, 5.2e-3),
        (2e-3, 0.0, 4.1e-3),
    ):
        pupil = Disc(1e-3, (x, y, 0.0))
        ends = {"volume": [x, y], "planar": [y], "axisymmetric": [math.hypot(x, y)]}[geometry]
        expected: list[slice] | None = []
        for axis, middle in enumerate(ends):
            faces = grid.origin[axis] + grid.spacing[axis] * np.arange(grid.shape[axis])
            low, high = middle - wide, middle + wide
            if geometry == "axisymmetric":
                low = 0.0
            if low < faces[0] or high > faces[-1]:
                expected = None
                break
            expected.append(slice(int(np.sum(faces <= low)) - 1, int(np.sum(faces < high)) + 3))
        found = bounds._coefficients(field, grid, pupil, wide - 1e-3)
        if expected is None:
            assert found is None
        else:
            np.testing.assert_array_equal(found, grid.coefficients[tuple(expected)])
    whole = IndexField.from_samples(
        np.ones((9, 9)) * 1e-6, origin=(-4e-3, 0.0), spacing=(1e-3, 1e-3), geometry="planar"
    )
    assert bounds._coefficients(whole, whole.samples, Disc(1e-3), 3e-3) is not None
    assert bounds._coefficients(whole, whole.samples, Disc(1e-3), 3.01e-3) is None
