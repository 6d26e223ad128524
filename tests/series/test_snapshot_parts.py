"""Parts of snapshots, look maps and meshes' rays by hand: slopes, probes, agreement, weights of samples."""

import math

import numpy as np
import pytest

from aerokernels import Disc, IndexField, QuadMesh, RayBundle, Rectangle, flow, trace
from aerokernels.pupils import direction_of
from aerokernels.series.bending import bending
from aerokernels.series.line_integrals import LineIntegrals, MeshIntegrals, NotLinearError
from aerokernels.series.look import _about_the_axis, _angles
from aerokernels.series.look_batch import _known, can_batch
from aerokernels.series.pupil_grid import pupil_grid
from aerokernels.series.snapshot import Snapshots, SnapshotSettings
from aerokernels.tracing.beyond import plane_beyond
from aerokernels.tracing.variants.causes import few_rows
from aerokernels.wavefront import remove_terms

from .fourier import CONSTANT, WAVELENGTH, Fourier

SHAPE, SPACING, ORIGIN = (25, 27, 15), 2.5e-3, (-0.03, -0.032, 0.0)
ALONG = np.array([0.15, -0.1, 1.0]) / math.sqrt(1.0325)


def snapshots(remove: tuple[str, ...] = ("piston", "tilt"), amplitude: float = 0.1, **options) -> Snapshots:
    """Snapshots of a volume of modes that move, seen aslant."""
    field = Fourier.random(3, amplitude=amplitude)
    field.mean = 1.0
    arrays = [field.on_grid(ORIGIN, SPACING, SHAPE, k * 1e-5) for k in range(2)]
    series = flow.open_series(
        arrays, time=[0.0, 1e-5], geometry="volume", origin=ORIGIN, spacing=[SPACING] * 3, ambient_density=0.9
    )
    given = {
        "direction": ALONG, "wavelength": WAVELENGTH, "relation": "gladstone-dale", "constant": CONSTANT,
        "composition": None, "interpolation": None, "tolerance": 0.01, "method": "auto", "trace_options": {},
    } | options  # fmt: skip
    grid = pupil_grid(Rectangle(0.016, 0.012, (0.0, 0.0, 0.004)), 8)
    return Snapshots(series, grid, SnapshotSettings(**given), remove)


def test_slopes_of_a_wavefront_are_differences_of_neighbours():
    """Mean squares over all pairs of pixels along each axis that have both, over the pixel's square."""
    made = snapshots()
    draw = np.random.default_rng(1)
    opd, valid = 1e-7 * draw.normal(size=48), draw.uniform(size=48) > 0.2
    found = np.where(valid, opd, np.nan).reshape(6, 8)
    expected = 0.0
    for axis in (0, 1):
        pairs = np.diff(found, axis=axis).ravel()
        expected += np.mean(pairs[np.isfinite(pairs)] ** 2) / 2e-3**2
    assert made._slope(opd, valid) == pytest.approx(expected, rel=1e-12, abs=0.0)
    assert made._slope(opd, np.zeros(48, dtype=bool)) == 0.0


@pytest.mark.parametrize("remove", [(), ("piston",), ("piston", "tilt"), ("focus",)])
def test_root_mean_squares_of_what_is_left(remove: tuple[str, ...]):
    made = snapshots(remove)
    rows = np.arange(3, 48, 2)
    values = np.random.default_rng(2).normal(size=len(rows)) + 2.0
    xy = made.grid.coordinates[rows]
    left = remove_terms(values, remove, xy)
    assert made._rms(values, rows) == pytest.approx(math.sqrt(np.mean(left**2)))
    some = np.where(np.arange(len(rows)) < 20, values, np.nan)
    assert made._rms(some, rows) == pytest.approx(made._rms(values[:20], rows[:20]))
    assert made._rms(values * np.nan, rows) == math.inf and made._rms(values[:0], rows[:0]) == 0.0


@pytest.mark.parametrize("amplitude", [0.003, 0.1])
def test_a_snapshot_is_straight_unless_its_rays_bend_too_much(amplitude: float):
    """Bending by its own function over 128 rays or all; above the tolerance it is traced."""
    made = snapshots(amplitude=amplitude)
    found = made(0)
    density = np.asarray(made.series.density(0), dtype=float)
    lines = LineIntegrals(made.series.mesh, made.grid.points, ALONG)
    opd = CONSTANT * lines(density, 0.9)
    contrast = lambda values: CONSTANT * (np.asarray(values) - 0.9)  # noqa: E731
    face = SPACING * (SHAPE[2] - 1)
    leave = made.grid.points + ((face - made.grid.points[:, 2]) / ALONG[2])[:, None] * ALONG
    index = made.settings.index_field(made.series[0])
    stop = plane_beyond(index, made.grid.pupil, ALONG).point @ ALONG
    bent, straight = bending(lines, density, contrast, stop - leave @ ALONG)
    few = made._sample(np.ones(48, dtype=bool))
    few = few[few_rows(len(few))]
    probe = made._rms((bent + straight - opd)[few], few)
    assert found.probe == pytest.approx(probe, rel=1e-6, abs=0.0)
    assert found.slope == pytest.approx(made._slope(opd, np.ones(48, dtype=bool)), rel=1e-9, abs=0.0)
    assert found.traced == (probe > 0.01 * WAVELENGTH)
    if not found.traced:
        np.testing.assert_allclose(found.opd, opd, rtol=1e-9)
        (step,) = found.varied().causes["step"].known
        assert np.abs(step.opd).max() <= np.abs(bent + straight - opd).max() and found.valid.all()
    # The bending is measured again only when the slopes have grown by half.
    second = made(1)
    assert math.isnan(second.probe) == (second.slope <= 1.5 * found.slope)


def test_bending_in_a_planar_field_is_that_of_bent_rays_and_no_larger():
    """The straight lines' OPD against rays traced to a thousandth of the tolerance; terms removed.

    The traces behind the measurement are within a tenth of the tolerance, 1e-3 wave.
    """
    y, z = ORIGIN[1] + SPACING * np.arange(SHAPE[1]), SPACING * np.arange(SHAPE[2])
    density = 3.0 + 2.0 * np.cos(300.0 * y)[:, None] * np.sin(np.pi * z / z[-1]) ** 2
    grid = {"geometry": "planar", "origin": ORIGIN[1:], "spacing": [SPACING] * 2, "ambient_density": 3.0}
    series = flow.open_series([density], time=[0.0], **grid)
    given = snapshots().settings
    made = Snapshots(series, pupil_grid(Rectangle(0.016, 0.012, (0.0, 0.0, -0.004)), 8), given, ("piston", "tilt"))
    found = made(0)
    field = given.index_field(series.field(density, 0))
    rays = RayBundle(made.grid.points, np.broadcast_to(ALONG, made.grid.points.shape))
    settings = {
        "until": plane_beyond(field, made.grid.pupil, ALONG),
        "wavelength": WAVELENGTH,
        "precision": "float64",
        "tolerance": 1e-5,
    }
    bent = trace(field, rays, method="adaptive", **settings).opd
    straight = CONSTANT * LineIntegrals(series.mesh, made.grid.points, ALONG)(density, 3.0)
    true = made._rms(bent - straight, np.arange(len(bent)))
    assert true > 5e-3 * WAVELENGTH  # five times what the measurement may be off by
    assert found.probe == pytest.approx(true, rel=0.05, abs=1e-3 * WAVELENGTH)


def test_measured_bending_grows_with_the_squared_slopes():
    """Until they have grown by half: the measurement of an interrupted run is resumed."""
    made = snapshots(amplitude=0.003)
    slope = made(0).slope
    for share, measured in ((1.49, True), (1.51, False), (0.5, True)):
        again = snapshots(amplitude=0.003)
        again.resume(slope / share, 3e-10)
        found = again(0)
        assert math.isnan(found.probe) is measured
    unknown = snapshots(amplitude=0.003)
    unknown.resume(slope, math.nan)
    assert not math.isnan(unknown(0).probe)
    limit = snapshots(amplitude=0.003)
    limit.resume(slope, 1.01 * 0.01 * WAVELENGTH)
    assert limit(0).traced
    straight = snapshots(amplitude=0.003, method="linear")
    found = straight(0)
    assert not found.traced and math.isnan(found.probe)


def test_a_snapshot_has_the_interpolant_that_was_asked_for():
    """None takes the one of its kind."""
    for asked, had in ((None, "cubic"), ("monotone", "monotone"), ("linear", "linear")):
        made = snapshots(interpolation=asked)
        field = made.settings.index_field(made.series.field(made.series.density(0), 0))
        assert field.interpolation == had and field.wavelength == WAVELENGTH


def test_densities_that_no_gas_has_are_refused_when_the_bending_is_measured():
    made = snapshots()
    samples = np.ones(SHAPE)
    made._check_range(samples, 1)
    for wrong in (-1.0, 0.0, 1e9):
        samples[2, 3, 4] = wrong
        with pytest.raises(ValueError, match="snapshot 1: "):
            made._check_range(samples, 1)


def test_what_cannot_be_summed_along_straight_lines():
    assert snapshots(method="trace").reason == "method 'trace' was requested"
    assert "not linear" in snapshots(interpolation="monotone").reason
    with pytest.raises(ValueError, match="method 'linear' cannot be had"):
        snapshots(interpolation="monotone", method="linear")


def test_which_maps_are_traced_together():
    options = {"remove": ("piston",)}
    samples, looks = np.full((5, 5, 5), 1e-6), np.zeros((12, 3))
    given = {"origin": (0.0, 0.0, 0.0), "spacing": (1e-3,) * 3, "geometry": "volume"}
    field = IndexField.from_samples(samples, **given)
    assert can_batch(field, looks, options) and not can_batch(field, looks[:11], options)
    assert not can_batch(IndexField.from_samples(samples, **given, interpolation="linear"), looks, options)
    flat = IndexField.from_samples(samples[0], origin=(0.0, 0.0), spacing=(1e-3,) * 2, geometry="planar")
    assert not can_batch(flat, looks, options)
    for more, good in (
        ({"backend": "warp"}, True), ({"backend": "opencl"}, False), ({"precision": "float64"}, False),
        ({"precision": "float32"}, True), ({"remove": ("piston", "tilt")}, True), ({"remove": ("focus",)}, False),
    ):  # fmt: skip
        assert can_batch(field, looks, options | more) is good


def test_known_air_is_left_by_a_thousandth_of_the_points():
    """Air that was cut off on one side: rays that leave through it are lost, those that leave elsewhere are not.

    A pupil of which half looks past the box misses air; one that looks past it with all rays does not.
    """
    place = np.linspace(-0.05, 0.1, 16)
    samples = 1e-5 * np.clip(place / 0.05, 0.0, 1.0)[:, None, None] * np.ones((16, 11, 11))
    whole = IndexField.from_samples(samples, origin=(-0.05,) * 3, spacing=(0.01,) * 3, geometry="volume")
    field = whole.resample(0.01, region=((-0.05,) * 3, (0.05,) * 3))
    looks = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-0.6, 0.0, 0.8]])
    axes = np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]] * 2 + [[[0.0, 1.0, 0.0], [0.8, 0.0, 0.6]]])
    points = np.random.default_rng(2).uniform(-5e-3, 5e-3, (40, 2))
    np.testing.assert_array_equal(_known(field, np.zeros(3), points, looks, axes, 1e-8), [0.0, 1.0, 1.0])
    np.testing.assert_array_equal(_known(whole, np.zeros(3), points, looks, axes, 1e-8), [1.0, 1.0, 1.0])
    beside = np.array([-0.06, 0.05, 0.0])
    np.testing.assert_array_equal(_known(whole, beside, points, looks, axes, 1e-8), [0.0, 1.0, 1.0])


def test_tilts_found_above_the_axis_are_turned_to_their_direction():
    """From the plane x = 0 toward +y: a rotation about z by the direction's angle from y."""
    draw = np.random.default_rng(3)
    looks, tilt = draw.normal(size=(6, 3)), draw.normal(size=(6, 3))
    looks[5, :2] = 0.0
    for one, (x, y, _), given in zip(_about_the_axis(tilt, looks), looks, tilt, strict=True):
        angle = math.atan2(x, y) if x or y else 0.0
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        np.testing.assert_allclose(one, [*(turn @ given[:2]), given[2]], atol=1e-12)
    np.testing.assert_array_equal(_angles("azimuth", 0.3, np.pi), [0.3])
    for wrong in ([], [[0.1]], [np.nan], [4.0 * np.pi + 0.01]):
        with pytest.raises(ValueError, match="azimuth"):
            _angles("azimuth", wrong, np.pi)
    assert _angles("azimuth", [np.pi, -np.pi], np.pi).size == 2
    np.testing.assert_allclose(
        direction_of(0.3, 0.2), [math.sin(0.3) * math.cos(0.2), math.sin(0.2), math.cos(0.3) * math.cos(0.2)]
    )


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.1, 0.3, -1.0), (0.0, -1.0, 0.4), (0.0, 1.0, 0.0)])
def test_rays_through_a_mesh_are_sums_over_even_samples(geometry: str, direction):
    """Four samples to a median cell over the longest way; bilinear weights of corners."""
    low = 0.0 if geometry == "axisymmetric" else -0.02
    first, z = np.meshgrid(np.linspace(low, 0.02, 9), np.linspace(0.01, 0.05, 12), indexing="ij")
    mesh = QuadMesh.structured(first + 1e-3 * np.sin(200.0 * z) * (first > 0.0), z, geometry)
    along = np.array(direction) / np.linalg.norm(direction)
    draw = np.random.default_rng(4)
    start = np.array([0.0, 0.0, 0.03]) - 0.05 * along + draw.uniform(-0.01, 0.01, (7, 3))
    values = draw.normal(size=len(mesh.vertices))
    low, high = mesh.box
    ends = []
    if along[2]:
        ends.append(((high[1] if along[2] > 0.0 else low[1]) - start[:, 2]) / along[2])
    if geometry == "planar" and along[1]:
        ends.append(((high[0] if along[1] > 0.0 else low[0]) - start[:, 1]) / along[1])
    if geometry == "axisymmetric" and math.hypot(along[0], along[1]):
        ends.append((np.hypot(start[:, 0], start[:, 1]) + high[0]) / math.hypot(along[0], along[1]))
    reach = np.maximum(np.min(ends, axis=0), 0.0)
    lines = MeshIntegrals(mesh, start, along)
    count = min(max(math.ceil(4.0 * reach.max() / float(np.median(mesh.cell_size))), 64), 20_000)
    expected, length = np.zeros(7), np.zeros(7)
    for ray in range(7):
        points = start[ray] + ((np.arange(count) + 0.5) / count * reach[ray])[:, None] * along
        across = np.hypot(points[:, 0], points[:, 1]) if geometry == "axisymmetric" else points[:, 1]
        local = np.stack([across, points[:, 2]], axis=1)
        cell = mesh.locate(local)
        for number in np.flatnonzero(cell >= 0):
            one = cell[number : number + 1]
            xi, eta = (float(c[0]) for c in mesh.local_coordinates(one, local[number : number + 1]))
            weight = [(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta]
            expected[ray] += reach[ray] / count * np.dot(weight, values[mesh.cells[one[0]]])
            length[ray] += reach[ray] / count
    assert length.any()
    np.testing.assert_allclose(lines.length, length, atol=1e-12)
    np.testing.assert_array_equal(lines.inside, length > 0.0)
    np.testing.assert_allclose(lines(values), expected, atol=1e-12)
    np.testing.assert_allclose(lines(values, 0.4), expected - 0.4 * length, atol=1e-12)
    if geometry == "planar":
        with pytest.raises(NotLinearError, match="never leave"):
            MeshIntegrals(mesh, start, np.array([1.0, 0.0, 0.0]))


def test_a_grid_of_a_pupil_reads_maps_of_its_good_pixels():
    """Weights of dark pixels are left out; a map of whole numbers is filled as asked."""
    grid = pupil_grid(Disc(0.01), 7)
    good = np.arange(int(grid.lit.sum())) % 3 > 0
    reader = grid.reader(good, ("piston",), WAVELENGTH)
    weight = grid.weight[grid.lit][good]
    np.testing.assert_allclose(reader.weight, weight / weight.sum())
    np.testing.assert_allclose(reader.coordinates, grid.coordinates[good])
    spread = grid.spread(np.arange(len(good)), -1)
    assert (spread[~grid.lit] == -1).all() and spread.dtype.kind == "i"
    np.testing.assert_array_equal(spread[grid.lit], np.arange(len(good)))
    wide = pupil_grid(Rectangle(0.02, 0.0051), 8)
    assert wide.weight.shape == (3, 8) and wide.pixel == pytest.approx(2.5e-3)
    assert wide.weight.sum() == pytest.approx(1.0) and wide.weight[0, 0] < wide.weight[1, 0]
    assert pupil_grid(Rectangle(0.02, 0.005), 8).weight.shape == (2, 8)
    with pytest.raises(ValueError, match="pixel_count"):
        pupil_grid(Disc(0.01), 1)
