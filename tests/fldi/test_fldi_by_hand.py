"""Rays of an FLDI by hand: where the beams meet the box, their grid, and sums along them."""

import math
from itertools import pairwise

import numpy as np
import pytest

from aerokernels import FLDI, IndexField, fldi_response
from aerokernels.fldi.known_beams import truncated_share
from aerokernels.fldi.rays import (
    BEYOND_REACH,
    REACH,
    _in_box,
    _span_of_disc,
    beam_grid,
    crossed,
    gathered,
    layer_count,
    ray_points,
)
from aerokernels.fldi.response import FLDIResponse
from aerokernels.tracing.lines import cell_along


def air(geometry: str = "volume", interpolation: str = "cubic") -> IndexField:
    """Smooth air in a box off the origin, cells of unequal sides."""
    shape, spacing, origin = (9, 11, 13), (4e-4, 5e-4, 6e-4), (-1.5e-3, -2.2e-3, 1e-3)
    if geometry != "volume":
        shape, spacing, origin = shape[1:], spacing[1:], origin[1:]
    if geometry == "axisymmetric":
        origin = (0.0, origin[1])
    places = np.meshgrid(*(o + h * np.arange(n) for o, h, n in zip(origin, spacing, shape, strict=True)), indexing="ij")
    samples = 1e-6 * sum(np.cos(900.0 * (k + 1) * place + k) for k, place in enumerate(places))
    return IndexField.from_samples(
        samples, origin=origin, spacing=spacing, geometry=geometry, interpolation=interpolation
    )


def instrument(**options) -> FLDI:
    given = {"focus": (2e-4, -1e-4, 4e-3), "axis": (0.1, -0.2, 1.0), "direction": (1.0, 0.4, 0.0), "wavelength": 633e-9}
    return FLDI(3e-4, 2e-5, **given | options)


def test_radii_and_axes_of_the_beams():
    """sqrt(w^2 + (z tan theta)^2); the divergence of a Gaussian beam unless another is given."""
    made = instrument()
    assert made.divergence == pytest.approx(633e-9 / (math.pi * 2e-5))
    assert float(made.radius(0.03)) == pytest.approx(math.hypot(2e-5, 0.03 * math.tan(made.divergence)))
    frame = np.array([made.direction, made.normal, made.axis])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(frame) == pytest.approx(1.0) and made.direction @ (1.0, 0.4, 0.0) > 0.0
    places = np.array([[0.5, -1.0], [2.0, 0.1]])
    distance = np.array([[-0.01, 0.02], [0.0, 0.03], [0.01, 0.01]])
    focus = np.array([1.0, 2.0, 3.0])
    found = ray_points(made, places, focus, -0.5, distance)
    for i, j in np.ndindex(3, 2):
        radius = float(made.radius(distance[i, j]))
        across = radius * (places[j, 0] * made.direction + places[j, 1] * made.normal)
        expected = focus - 0.5 * 3e-4 * made.direction + distance[i, j] * made.axis + across
        np.testing.assert_allclose(found[i, j], expected, atol=1e-15)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.1, -0.2, 1.0), (0.0, 1.0, 0.1)])
def test_where_the_beams_are_in_the_box(geometry: str, axis):
    """A disc of the widest radius and half of the separation, moved along the axis, by a search along it."""
    field, made = air(geometry), instrument(axis=axis, direction=(1.0, 0.0, 0.0))
    focus = np.asarray(made.focus)
    ends = crossed(field, made, focus)
    reach = REACH * max(float(made.radius(end)) for end in ends) + 0.5 * 3e-4
    low, high = field.box
    wider = reach * np.sqrt(1.0 - np.asarray(made.axis) ** 2)
    along = np.linspace(-0.05, 0.05, 200_001)
    points = focus + along[:, None] * made.axis
    if geometry == "axisymmetric":
        inside = np.hypot(points[:, 0], points[:, 1]) <= high[0] + reach
        inside &= (points[:, 2] >= low[2] - wider[2]) & (points[:, 2] <= high[2] + wider[2])
    else:
        inside = ((points >= low - wider) & (points <= high + wider)).all(axis=1)
    assert ends == pytest.approx((along[inside][0], along[inside][-1]), abs=2e-5)
    span = _span_of_disc(field, focus, np.asarray(made.axis), reach)
    assert span == pytest.approx((along[inside][0], along[inside][-1]), abs=1e-6)
    far = focus + 1.0 * np.array([0.0, 1.0, 0.0] if geometry != "volume" else [1.0, 0.0, 0.0])
    if abs(axis[1]) < 0.5:
        assert crossed(field, made, far) is None


def test_beams_along_an_endless_axis_never_leave():
    with pytest.raises(ValueError, match="never leave"):
        crossed(air("planar"), instrument(axis=(1.0, 0.0, 0.0), direction=(0.0, 1.0, 0.0)), np.array([0.0, 0.0, 4e-3]))


@pytest.mark.parametrize("rays", [None, 6, 9])
@pytest.mark.parametrize("reach", [2e-3, 0.3, 3.0])
def test_rays_of_a_beam_are_a_grid_of_its_light(rays: int | None, reach: float):
    """As many as the field's cells across the widest beam, odd, 20 to 192; shares exp(-2 r^2) within 2.6 radii."""
    field, made = air(), instrument()
    places, share, coarse = beam_grid(field, made, (-0.5 * reach, reach), rays)
    widest = float(made.radius(reach))
    counts = []
    for axis in (made.direction, made.normal):
        cell = float(cell_along(field, axis[None])[0])
        wanted = math.ceil(2.0 * 2.6 * widest / cell)
        counts.append(min(max(wanted, 20), 192) | 1 if rays is None else rays | 1)
    u, v = (np.linspace(-2.6, 2.6, count) for count in counts)
    expected, light, half = [], [], []
    for j, y in enumerate(v):
        for i, x in enumerate(u):
            if x * x + y * y <= 2.6**2:
                expected.append((x, y))
                light.append(math.exp(-2.0 * (x * x + y * y)))
                middle = (i - counts[0] // 2) % 2 == 0 and (j - counts[1] // 2) % 2 == 0
                half.append(light[-1] if middle else 0.0)
    np.testing.assert_allclose(places, expected, atol=1e-12)
    np.testing.assert_allclose(share, np.array(light) / sum(light), rtol=1e-12)
    np.testing.assert_allclose(coarse, np.array(half) / sum(half), rtol=1e-12)
    assert pytest.approx(math.exp(-2.0 * 2.6**2)) == BEYOND_REACH


def test_layers_along_the_beams():
    """One to a cell of a cubic field, two of one with kinks; 8 to 2048."""
    made = instrument(axis=(0.0, 0.0, 1.0))
    for kind, per_cell in (("cubic", 1.0), ("linear", 2.0)):
        for cells in (3.0, 20.4, 5000.0):
            expected = math.ceil(min(max(per_cell * cells, 8.0), 2048.0))
            assert layer_count(air("volume", kind), made, (-1e-3, -1e-3 + cells * 6e-4)) == expected


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize(("coarser", "layers"), [(1, None), (2, 7), (3, 7)])
def test_paths_along_the_beams_are_gauss_sums_in_the_box(geometry: str, coarser: int, layers: int | None):
    """Two points in the part of each layer between two points of the ray that is in the box."""
    field, made = air(geometry), instrument()
    focus = np.asarray(made.focus) + np.array([0.0, 1.5e-3, 0.0])
    ends = crossed(field, made, focus)
    places = np.array([[0.0, 0.0], [1.5, -0.4], [-2.0, 1.0], [0.3, 2.5]])
    found, passes = gathered(field, made, places, focus, ends, coarser=coarser, layers=layers)
    count = math.ceil((layer_count(field, made, ends) if layers is None else layers) / coarser)
    edges = np.linspace(*ends, count + 1)
    low, high = field.box
    expected = np.zeros((2, 4))
    for beam, side in enumerate((0.5, -0.5)):
        for ray in range(4):
            for begin, end in pairwise(edges):
                at = ray_points(made, places[ray : ray + 1], focus, side, np.array([[begin], [end]]))[:, 0]
                shares = np.linspace(0.0, 1.0, 20_001)
                local = field.local_coordinates(at)
                cut = local[0] + shares[:, None] * (local[1] - local[0])
                bounds = {
                    "volume": (low, high),
                    "planar": (low[1:], high[1:]),
                    "axisymmetric": (np.array([-1.0, low[2]]), high[[0, 2]]),
                }
                inside = ((cut >= bounds[geometry][0]) & (cut <= bounds[geometry][1])).all(axis=1)
                if inside.sum() < 2:
                    continue
                first, last = shares[inside][0], shares[inside][-1]
                for node in (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0)):
                    distance = begin + (end - begin) * (first + node * (last - first))
                    point = ray_points(made, places[ray : ray + 1], focus, side, np.array([[distance]]))[0]
                    expected[beam, ray] += 0.5 * (end - begin) * (last - first) * float(field.contrast_at(point)[0])
    assert passes.all() and np.abs(expected).max() > 0.0
    np.testing.assert_allclose(found, expected, atol=3e-4 * np.abs(expected).max())


def test_parts_of_segments_in_a_box():
    """Shares of the way between two points; nothing where the box is missed."""
    field = air("planar")
    low, high = (corner[1:] for corner in field.box)
    middle, size = 0.5 * (low + high), high - low
    local = np.array([[middle - (0.0, 1.0) * size], [middle], [middle + (1.0, 0.0) * size], [middle + 3.0 * size]])
    first, last = _in_box(field, local)
    np.testing.assert_allclose(first[:, 0], [0.5, 0.0, 0.0])
    np.testing.assert_allclose(last[:, 0], [1.0, 0.5, 0.0])


def test_a_response_from_the_sums_of_its_rays():
    """Visibility and phase of the mean phasor, the mean phase, and the error's parts by half of the rays and layers."""
    field, made = air(), instrument()
    found = fldi_response(field, made, rays=9)
    focus = np.asarray(made.focus)
    ends = crossed(field, made, focus)
    places, share, coarse = beam_grid(field, made, ends, 9)
    (first, second), _ = gathered(field, made, places, focus, ends)
    difference = 2.0 * np.pi / 633e-9 * (first - second)
    whole, half = (weight @ np.exp(1j * difference) for weight in (share, coarse))
    assert float(found.phase) == pytest.approx(np.angle(whole)) and float(found.visibility) == pytest.approx(abs(whole))
    assert float(found.mean_phase) == pytest.approx(share @ difference)
    least = abs(np.angle(half / whole)) + BEYOND_REACH * np.ptp(difference)
    few = np.flatnonzero(coarse)
    changes = []
    for thicker in (2, 3):
        (one, other), _ = gathered(field, made, places[few], focus, ends, coarser=thicker)
        changes.append(abs(coarse[few] @ (2.0 * np.pi / 633e-9 * (one - other) - difference[few])))
    assert float(found.error) >= least + max(changes) - 1e-15
    assert float(found.truncated) == pytest.approx(truncated_share(field, made, focus, ends, REACH))
    for bias in (0.3, 0.5 * np.pi):
        light = 0.5 * (1.0 + found.visibility * math.cos(float(found.phase) - bias))
        assert float(found.signal(bias)) == pytest.approx(float(light))


def test_spectra_of_responses_need_even_times():
    """From four snapshots on, in segments of four to all of them."""
    count = 64
    phase = np.sin(0.3 * np.arange(count)) + 0.1 * np.random.default_rng(1).normal(size=count)
    make = lambda time: FLDIResponse(phase[: len(time)], *[np.ones(len(time))] * 4, time, instrument())  # noqa: E731
    time = 2e-6 * np.arange(count)
    frequency, power = make(time).spectrum(16)
    assert frequency[1] == pytest.approx(1.0 / (16 * 2e-6)) and len(power) == 9
    whole, _ = make(time).spectrum()
    assert whole[1] == pytest.approx(1.0 / (64 * 2e-6))
    for segment in (3, 65):
        with pytest.raises(ValueError, match="segment"):
            make(time).spectrum(segment)
    make(time).spectrum(4)
    make(time).spectrum(64)
    make(time[:4]).spectrum()
    with pytest.raises(ValueError, match="at least 4"):
        make(time[:3]).spectrum()
    for late, fine in ((0.9e-12, True), (1.1e-11, False)):
        uneven = time.copy()
        uneven[-1] += late
        if fine:
            make(uneven).spectrum()
        else:
            with pytest.raises(ValueError, match="even times"):
                make(uneven).spectrum()
