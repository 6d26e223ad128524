"""Parts of pictures by hand: windows, light spread over pixels, fringes, rays of a prism, fronts of drawn pictures."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from aerokernels import Annulus, Disc, IndexField
from aerokernels.schlieren import Bench, interferogram, measure_stand_off, shadowgraph
from aerokernels.schlieren.fringes import fringe_picture
from aerokernels.schlieren.line_of_sight import LineOfSight, _is_even, line_of_sight
from aerokernels.schlieren.shadowgraph import _spread, shadow_picture, spread
from aerokernels.schlieren.shock_angle import _line_through, columns_in, measure_shock_angle
from aerokernels.schlieren.stand_off import _dark_edge
from aerokernels.schlieren.window import _pixels, _view_axes, make_window, ray_lines

WAVELENGTH = 633e-9


def air(geometry: str = "volume", interpolation: str = "linear") -> IndexField:
    """A weak linear gradient in a box off the origin: nothing bends, and each ray's path is its own."""
    shape, spacing, origin = (5, 7, 9), (2e-3, 1.5e-3, 1e-3), (-3e-3, -4e-3, 2e-3)
    if geometry != "volume":
        shape, spacing, origin = shape[1:], spacing[1:], origin[1:]
    if geometry == "axisymmetric":
        origin = (0.0, origin[1])
    places = np.meshgrid(*(o + h * np.arange(n) for o, h, n in zip(origin, spacing, shape, strict=True)), indexing="ij")
    samples = 2e-7 + 1e-5 * sum((k + 1.0) * place for k, place in enumerate(places[-2:]))
    return IndexField.from_samples(
        samples, origin=origin, spacing=spacing, geometry=geometry, interpolation=interpolation
    )


def rays(k: int = 2, shape: tuple[int, int] = (5, 6), seed: int = 1) -> LineOfSight:
    """Light traced through something: deflections, paths and displacements of noise, a few rays without an end."""
    window = make_window(air(), "z", (-2e-3, 1e-3, -1e-3, 2e-3), shape[::-1], None)
    draw = np.random.default_rng(seed)
    rows, columns = shape[0] * k, shape[1] * k
    through = draw.uniform(size=(rows, columns)) > 0.1
    deflection = 1e-4 * draw.normal(size=(rows, columns, 2))
    opd = WAVELENGTH * draw.normal(size=(rows, columns))
    deflection[~through], opd[~through] = np.nan, np.nan
    blocked = ~through & (draw.uniform(size=through.shape) > 0.5)
    return LineOfSight(
        window, k, deflection, opd, 1e-4 * draw.normal(size=(rows, columns, 2)), through, blocked, WAVELENGTH, 1e-3
    )


@pytest.mark.parametrize("view", ["x", "y", "z", (0.3, -0.2, 1.0), (0.01, 1.0, 0.02)])
def test_axes_of_a_view_are_right_handed_and_upright(view):
    """Right, up and the way back to the eye make a right hand; up has no part along the horizontal."""
    forward, right, up = _view_axes(view)
    frame = np.array([right, up, -forward])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    upright = np.array([1.0, 0.0, 0.0]) if abs(forward[1]) >= 0.99 else np.array([0.0, 1.0, 0.0])
    assert right @ upright == pytest.approx(0.0, abs=1e-15) and up @ upright > 0.0
    expected = (
        {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}.get(view) if isinstance(view, str) else view
    )
    np.testing.assert_allclose(forward, np.array(expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("view", ["x", "z", (0.3, -0.2, 1.0)])
def test_a_window_takes_in_the_box_and_its_light_starts_outside_of_it(view):
    """By corners of the box; a 200th of the way beyond its ends. Square pixels, as many as asked on the longer side."""
    field = air()
    low, high = field.box
    window = make_window(field, view, None, 12, None)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    along, across, up = (corners @ axis for axis in (window.forward, window.right, window.up))
    reach = 0.005 * np.ptp(along)
    assert window.entry == pytest.approx(along.min() - reach) and window.middle == pytest.approx(
        0.5 * (along.min() + along.max())
    )
    assert window.exit == pytest.approx(along.max() + reach)
    counts = [max(1, round(12 * np.ptp(one) / max(np.ptp(across), np.ptp(up)))) for one in (across, up)]
    for place, pitch, one, count in zip(
        (window.horizontal, window.vertical), window.pitch, (across, up), counts, strict=True
    ):
        assert len(place) == count and pitch == pytest.approx(np.ptp(one) / count)
        np.testing.assert_allclose(place, one.min() + (np.arange(count) + 0.5) * pitch, atol=1e-15)
    lines = ray_lines(window, 3)
    for line, place, pitch in zip(lines, (window.horizontal, window.vertical), window.pitch, strict=True):
        expected = [centre + pitch * off for centre in place for off in (-1.0 / 3.0, 0.0, 1.0 / 3.0)]
        np.testing.assert_allclose(line, expected, atol=1e-15)


def test_windows_of_planar_fields_and_of_given_extents():
    """A planar field ends at its width, where its rays start; pixels may be of two numbers and of any sides."""
    window = make_window(air("planar"), "x", None, (3, 4), 0.04)
    assert (window.entry, window.exit) == (-0.02, 0.02) and (len(window.horizontal), len(window.vertical)) == (3, 4)
    with pytest.raises(ValueError, match="planar field is infinite"):
        make_window(air("planar"), "x", None, 8, 0.0)
    with pytest.raises(ValueError, match="look through a planar field along x"):
        make_window(air("planar"), "z", None, 8, 0.04)
    low, high, right, up = np.zeros(3), np.array([4.0, 2.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    horizontal, vertical, pitch = _pixels(low, high, right, up, (1.0, 2.0, -0.5, 1.5), 8)
    assert (len(horizontal), len(vertical), pitch) == (4, 8, (0.25, 0.25))
    assert horizontal[0] == 1.125 and vertical[-1] == 1.375
    assert len(_pixels(low, high, right, up, (0.0, 8.0, 0.0, 0.01), 2)[1]) == 1
    for extent, count in (
        ((1.0, 1.0, 0.0, 1.0), 8),
        ((0.0, 1.0, 2.0, 1.0), 8),
        ((0.0, 8.1, 0.0, 1.0), (2, 8)),
        ((0.0, 1.0), 8),
    ):
        with pytest.raises(ValueError, match="extent"):
            _pixels(low, high, right, up, extent, count)
    for count in (0, 1.5, (1, 2, 3)):
        with pytest.raises(ValueError, match="pixel_count"):
            _pixels(low, high, right, up, (0.0, 1.0, 0.0, 1.0), count)


def test_means_over_the_rays_of_a_pixel():
    """Those that came through; more than half of a pixel must be hidden to count as body."""
    traced = rays()
    mean = traced.pixel_mean(traced.deflection)
    for row, column in np.ndindex(5, 6):
        part = traced.deflection[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].reshape(-1, 2)
        good = part[np.isfinite(part).all(axis=1)]
        expected = good.mean(axis=0) if len(good) else np.full(2, np.nan)
        np.testing.assert_allclose(mean[row, column], expected)
        hidden = traced.blocked[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].mean()
        assert traced.frame["blocked"][row, column] == (hidden > 0.5)
    across, along = traced.ray_grid
    np.testing.assert_allclose(across[3], ray_lines(traced.window, 2)[0])
    np.testing.assert_allclose(along[:, 3], ray_lines(traced.window, 2)[1])
    assert _is_even(np.array([-2.0, -1.0, 1.0, 2.0])) and not _is_even(np.array([-2.0, -1.0, 1.0, 2.1]))


@pytest.mark.parametrize("spacing", [None, 1.3e-3])
def test_fringes_by_their_formula(spacing: float | None):
    """(1 + V cos(2 pi (opd / lambda + s / spacing + phase))) / 2 times the exposure; dark where no ray came through."""
    traced, turn, phase, visibility, exposure = rays(), 0.7, 0.2, 0.8, 1.3
    found = fringe_picture(
        traced, fringe_spacing=spacing, fringe_angle=turn, phase=phase, visibility=visibility, exposure=exposure
    )
    window, k = traced.window, 2
    light = np.zeros((5, 6))
    right, up = ray_lines(window, k)
    middle = [0.5 * (one[0] + one[-1]) for one in (window.horizontal, window.vertical)]
    assert max(abs(one) for one in middle) > 1e-4
    for row, column in np.ndindex(10, 12):
        if traced.through[row, column]:
            waves = traced.opd[row, column] / WAVELENGTH + phase
            if spacing is not None:
                place = (right[column] - middle[0]) * math.cos(turn) + (up[row] - middle[1]) * math.sin(turn)
                waves += place / spacing
            light[row // 2, column // 2] += 0.25 * 0.5 * (1.0 + visibility * math.cos(2.0 * math.pi * waves))
    np.testing.assert_allclose(found.intensity, np.clip(exposure * light, 0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(found.opd, traced.pixel_mean(traced.opd))
    with pytest.raises(ValueError, match="less than two pixels"):
        fringe_picture(traced, fringe_spacing=1.99 * max(window.pitch))
    assert fringe_picture(traced, fringe_spacing=2.01 * max(window.pitch)).fringe_spacing is not None


def test_an_interferogram_of_a_source_of_some_size_is_the_mean_of_its_points():
    """Each point sends light at an angle, to the same pixels of the plane in focus."""
    field, bench = air(interpolation="cubic"), Bench(2e-3, 0.8, source_points=3, focus=4e-3)
    options = {"view": "z", "pixel_count": (4, 5), "extent": (-2e-3, 2e-3, -2e-3, 2e-3), "precision": "float64"}
    found = interferogram(field, bench=bench, exposure=0.7, phase=0.1, **options)
    points, shares = bench.points()
    light = sum(
        share * fringe_picture(line_of_sight(field, focus=4e-3, tilt=tuple(point), **options), phase=0.1).intensity
        for point, share in zip(points, shares, strict=True)
    )
    np.testing.assert_allclose(found.intensity, 0.7 * light, atol=1e-12)
    middle = line_of_sight(field, focus=4e-3, tilt=(0.0, 0.0), **options)
    np.testing.assert_allclose(found.opd, middle.opd)
    assert found.exposure == 0.7


def test_light_is_spread_evenly_over_where_it_lands():
    """A map that stretches each axis on its own: overlaps of rectangles with pixels, exactly."""
    window = rays(1).window
    nx, ny = 6, 5
    draw = np.random.default_rng(2)
    u, v = np.sort(draw.uniform(-1.0, 6.5, 9)), np.sort(draw.uniform(-1.0, 5.5, 8))
    rest = np.stack(np.meshgrid(np.arange(9.0), np.arange(8.0)), axis=-1)
    landing = np.stack(
        np.meshgrid(window.horizontal[0] + u * window.pitch[0], window.vertical[0] + v * window.pitch[1]), axis=-1
    )
    share = draw.uniform(0.2, 1.0, (7, 8))
    expected = np.zeros((ny, nx))
    for i, j in np.ndindex(7, 8):
        for row, column in np.ndindex(ny, nx):
            part = [
                max(min(b, at + 0.5) - max(a, at - 0.5), 0.0) / (b - a)
                for a, b, at in ((u[j], u[j + 1], column), (v[i], v[i + 1], row))
            ]
            expected[row, column] += share[i, j] * part[0] * part[1]
    found = _spread(rest, landing - rest, window, share)
    # A square wider than a third of a pixel is cut into parts, each of which is a rectangle: still exact.
    np.testing.assert_allclose(found, expected, atol=1e-6)
    lost = landing - rest
    lost[3, 4] = np.nan
    without = share.copy()
    without[2:4, 3:5] = 0.0
    np.testing.assert_allclose(_spread(rest, lost, window, share), _spread(rest, landing - rest, window, without))
    whole = _spread(rest, landing - rest, window)
    np.testing.assert_allclose(whole, _spread(rest, landing - rest, window, np.ones((7, 8))))


@pytest.mark.parametrize("k", [1, 2])
def test_a_linear_map_brightens_by_its_squeeze(k: int):
    """Shifts a + b x and c + d y that leave the border as it is: irradiance of one square over another."""
    traced = rays(k, (24, 30))
    across, along = traced.ray_grid
    pitch = traced.window.pitch
    flat = np.stack([np.full(across.shape, 0.7 * pitch[0]), np.full(across.shape, -1.3 * pitch[1])], axis=-1)
    np.testing.assert_allclose(spread(traced, flat), 1.0, atol=1e-9)
    shift = flat + np.stack([0.1 * (across - across.mean()), -0.05 * (along - along.mean())], axis=-1)
    inner = spread(traced, shift)[6:-6, 6:-6]
    np.testing.assert_allclose(inner, 1.0 / 1.1 / 0.95, rtol=1e-6)
    share = 0.5 + 0.0 * across
    np.testing.assert_allclose(spread(traced, shift, share)[6:-6, 6:-6], 0.5 / 1.1 / 0.95, rtol=1e-6)
    # Light goes on from the plane in focus to the screen, by the tangent of its angle.
    sine = 0.3
    slanted = replace(traced, deflection=np.full(shift.shape, sine), displacement=np.zeros(shift.shape))
    distance = 2e-3
    tangent = sine / math.sqrt(1.0 - 2.0 * sine**2)
    onward = distance - (traced.focus - traced.window.middle)
    squeezed = replace(
        slanted, deflection=np.stack([sine + 0.05 * across / onward, np.full(across.shape, sine)], axis=-1)
    )
    found = shadow_picture(squeezed, distance=distance, exposure=0.4)
    ways = squeezed.deflection / np.sqrt(1.0 - np.sum(squeezed.deflection**2, axis=-1, keepdims=True))
    np.testing.assert_allclose(found.irradiance, spread(traced, onward * ways), rtol=1e-9)
    np.testing.assert_allclose(found.intensity, np.clip(0.4 * found.irradiance, 0.0, 1.0))
    assert tangent > sine and found.distance == distance
    with pytest.raises(ValueError, match="at least 2 x 2 rays"):
        shadow_picture(rays(1, (1, 4)), distance=0.1)


@pytest.mark.parametrize("view", ["z", (0.2, -0.1, 1.0)])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.02, -0.03)])
def test_undisturbed_light_is_where_it_is_in_the_plane_in_focus(view, tilt):
    """No contrast: no deflection, displacement or path, whatever the angle and the plane; weak air adds its path."""
    field = air()
    still = replace(field, samples=replace(field.samples, samples=0.0 * field.samples.samples))
    options = {
        "view": view,
        "pixel_count": (3, 4),
        "focus": 3e-3,
        "tilt": tilt,
        "precision": "float64",
        "extent": (-1e-3, 1.2e-3, -1e-3, 1.5e-3),
    }
    found = line_of_sight(still, **options)
    assert found.through.all() and found.focus == pytest.approx(found.window.middle + 3e-3)
    for values in (found.deflection, found.displacement, found.opd):
        np.testing.assert_allclose(values, 0.0, atol=1e-13)
    # Along the straight ray through each pixel of the plane in focus, linear between nodes.
    moved = line_of_sight(field, **options)
    tangent = np.array(tilt) / math.sqrt(1.0 - tilt[0] ** 2 - tilt[1] ** 2)
    window = found.window
    way = window.forward + tangent[0] * window.right + tangent[1] * window.up
    across, along = found.ray_grid
    depth = np.linspace(window.entry, window.exit, 4001)
    for row, column in ((0, 0), (1, 2), (3, 1)):
        base = across[row, column] * window.right + along[row, column] * window.up
        points = base + window.forward * found.focus + (depth - found.focus)[:, None] * way
        path = np.trapezoid(field.contrast_at(points), depth) * np.linalg.norm(way)
        assert moved.opd[row, column] == pytest.approx(path, rel=2e-3, abs=0.0)


@pytest.mark.parametrize(
    ("source", "size"), [("disc", 2e-3), ("square", 2e-3), (Annulus(3.0, 1.0), 2e-3), (Disc(0.05), None)]
)
def test_an_edge_holds_back_the_light_below_it(source, size):
    """By a fine lattice over the source: the share below the edge, and that of one of its parts."""
    bench = Bench(size, 0.5, source=source, source_points=3)
    half = 0.5 * bench.angle
    assert (
        bench.angle == pytest.approx((0.1 if size is None else 2e-3) / 0.5) and bench.sensitivity == 1.0 / bench.angle
    )
    place = half * (2.0 * (np.arange(1200) + 0.5) / 1200 - 1.0)
    x, y = np.meshgrid(place, place)
    radius = np.hypot(x, y)
    lit = np.ones(x.shape, bool) if source == "square" else radius < half
    if isinstance(source, Annulus):
        lit &= radius > half / 3.0
    for cut_off in (0.2, 0.5, 0.9):
        edge = bench.edge(cut_off)
        assert lit[x < edge].sum() / lit.sum() == pytest.approx(cut_off, abs=2e-3)
        assert float(bench.held_back(np.asarray(edge))) == pytest.approx(cut_off, abs=1e-9)
    points, shares = bench.points()
    third = 2.0 * half / 3.0
    edge, cut = bench.edge(0.4), 0.21 * half
    for point, share in zip(points, shares, strict=True):
        part = lit & (np.abs(x - point[0]) < 0.5 * third) & (np.abs(y - point[1]) < 0.5 * third)
        assert share == pytest.approx(part.sum() / lit.sum(), abs=2e-3)
        passed = float(bench.passed(point, np.asarray(cut), 0.4))
        assert passed == pytest.approx((part & (x + cut > edge)).sum() / part.sum(), abs=5e-3)


def test_a_dark_edge_is_half_way_between_what_is_before_and_the_body():
    line = np.array([0.5, 0.5, 0.9, 0.8, 0.7, 0.6, 0.3, 0.1, 0.06, 0.02, 0.0, 0.0, 0.0])
    # The body begins at sample 7, darker than 0.1; before it 0.7 at most, behind it 0.06 on average.
    half = 0.5 * (0.7 + (0.1 + 0.06 + 0.02) / 3.0)
    assert _dark_edge(line, 0.1, 1.5) == pytest.approx(6.0 - (half - 0.3) / (0.6 - 0.3))
    assert math.isnan(_dark_edge(line, 0.1, math.nan)) and math.isnan(_dark_edge(line, -0.1, 1.5))
    spot = np.array([0.5, 0.5, 0.0, 0.0, 0.5, 0.9, 0.0, 0.0, 0.0, 0.0])
    assert 5.0 < _dark_edge(spot, 0.1, 0.5) < 6.0  # two dark pixels are no body


@pytest.mark.parametrize("upstream", ["right", "left"])
def test_a_stand_off_between_two_parabolas(upstream: str):
    """A ramp of brightness ends at the shock, a dark body begins at its nose: both to a hundredth of a pixel."""
    pitch = 1e-4
    horizontal, vertical = pitch * np.arange(-100, 101), pitch * (np.arange(-30, 31) + 0.3) + 2e-3
    sign = 1.0 if upstream == "right" else -1.0
    height = (vertical - 2e-3)[:, None]
    inward = -(sign * horizontal[None, :] - (6e-3 - 40.0 * height**2)) / pitch  # pixels behind the shock
    bright = 0.5 + 0.3 * np.clip(inward / 4.0 + 0.5, 0.0, 1.0)
    body = -(sign * horizontal[None, :] - (2e-3 - 60.0 * height**2)) / pitch
    picture = SimpleNamespace(
        intensity=bright * np.clip(0.5 - body / 2.0, 0.0, 1.0), horizontal=horizontal, vertical=vertical
    )
    found = measure_stand_off(picture, 1.5e-3, axis=2e-3, upstream=upstream, smoothing=0.0)
    assert found.shock == pytest.approx(sign * 6e-3, abs=0.02 * pitch)
    assert found.nose == pytest.approx(sign * 2e-3, abs=0.1 * pitch)
    assert found.distance == pytest.approx(abs(found.shock - found.nose)) and found.standard_error < 0.05 * pitch
    np.testing.assert_allclose(
        found.shock_points[:, 0], sign * (6e-3 - 40.0 * (found.shock_points[:, 1] - 2e-3) ** 2), atol=0.05 * pitch
    )
    assert len(found.shock_points) == (np.abs(vertical - 2e-3) <= 1.5e-3).sum()
    known = measure_stand_off(picture, 1.5e-3, axis=2e-3, upstream=upstream, nose=1e-3, smoothing=0.0)
    assert known.distance == pytest.approx(abs(found.shock - 1e-3)) and known.nose == 1e-3
    assert known.standard_error < found.standard_error and len(known.nose_points) == 0
    with pytest.raises(ValueError, match="rows of pixels"):
        measure_stand_off(picture, 3.4 * pitch, axis=2e-3, upstream=upstream)
    measure_stand_off(picture, 4.5 * pitch, axis=2e-3, upstream=upstream, smoothing=0.0)


def test_columns_and_lines_of_a_shocks_window():
    """Both ends count; eight columns at least. A line goes through its two points."""
    picture = SimpleNamespace(horizontal=np.arange(20.0), vertical=np.arange(40.0), intensity=np.zeros((40, 20)))
    np.testing.assert_array_equal(columns_in(picture, (3.0, 10.0)), np.arange(3, 11))
    for window, words in (((3.1, 10.0), "7 columns"), ((3.0, 9.9), "7 columns"), ((5.0, 5.0), "increasing")):
        with pytest.raises(ValueError, match=words):
            columns_in(picture, window)
    line = _line_through(((1.0, 5.0), (3.0, 4.0)), np.array([-1.0, 2.0]))
    np.testing.assert_allclose(line, [6.0, 4.5])
    for wrong in (((1.0, 5.0), (1.0, 4.0)), ((1.0, np.nan), (3.0, 4.0))):
        with pytest.raises(ValueError, match="near"):
            _line_through(wrong, np.zeros(1))


@pytest.mark.parametrize("degree", [1, 2])
def test_the_angle_of_an_inner_band_near_a_line(degree: int):
    """A parabola-shaped band on each column: its tops, and the curve through them about the middle."""
    pitch = 1e-4
    horizontal, vertical = 2.0 * pitch * np.arange(50), pitch * (np.arange(120) - 20.0)
    top = 4e-3 + 0.35 * horizontal + (20.0 if degree == 2 else 0.0) * (horizontal - 3e-3) ** 2
    intensity = 0.5 + 0.3 * np.maximum(1.0 - ((vertical[:, None] - 1e-3 - top) / pitch / 6.0) ** 2, 0.0)
    picture = SimpleNamespace(intensity=intensity, horizontal=horizontal, vertical=vertical)
    near = ((0.0, 4.1e-3), (9e-3, 4.1e-3 + 0.35 * 9e-3))
    found = measure_shock_angle(picture, (2e-3, 6e-3), degree=degree, axis=1e-3, near=near, reach=1.2e-3, smoothing=0.0)
    middle = 4e-3
    slope = 0.35 + (40.0 * (middle - 3e-3) if degree == 2 else 0.0)
    assert found.place == pytest.approx(middle) and found.angle == pytest.approx(math.atan(slope), abs=1e-4)
    assert found.curve[0] == pytest.approx(np.interp(middle, horizontal, top), abs=2e-7)
    np.testing.assert_allclose(found.points[:, 1], 1e-3 + np.interp(found.points[:, 0], horizontal, top), atol=2e-7)
    assert found.residual_rms < 2e-7 and found.standard_error < 1e-4 and math.isnan(found.roll)


def test_a_shadowgraph_of_a_bench_has_its_angle():
    field = air(interpolation="cubic")
    options = {"view": "z", "pixel_count": (6, 7), "extent": (-2e-3, 2e-3, -2e-3, 2e-3), "precision": "float64"}
    bench = Bench(2e-3, 0.5, source="disc")
    found = shadowgraph(field, distance=0.3, bench=bench, **options)
    plain = shadowgraph(field, distance=0.3, source_angle=4e-3, **options)
    np.testing.assert_allclose(found.irradiance, plain.irradiance)
    assert found.source_angle == pytest.approx(4e-3)
