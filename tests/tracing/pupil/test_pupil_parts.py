"""Parts of pupils: radial quadrature, lattices, the order and sums of rays, the plane of a job, air at its ends."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.stats import qmc

from aerokernels import Annulus, Disc, IndexField, Plane, RayBundle, Rectangle
from aerokernels.medium import Body
from aerokernels.tracing.lines import meets_wall
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.pupil import quadrature as lattices
from aerokernels.tracing.pupil import quadrature as radial
from aerokernels.tracing.pupil.air import PupilAir, pupil_air
from aerokernels.tracing.pupil.job import _check_size
from aerokernels.tracing.pupil.run import KEPT_BYTES, check_memory
from aerokernels.tracing.pupil.sums import (
    MOMENT_COUNT,
    PupilSums,
    PupilTask,
    group_count,
    holds_tolerance,
    joined_counts,
    point_order,
    radial_rays,
    replicate_seeds,
)
from aerokernels.tracing.stop import plane_beyond

UP = np.array([0.0, 0.0, 1.0])


def box_field(geometry: str = "volume", contrast: float = 3e-4, body: Body | None = None) -> IndexField:
    """A box of 2 by 3 by 4 m (r up to 3 m) with cells of 0.5, 0.75 and 1 m."""
    axes = [0, 1, 2] if geometry == "volume" else [1, 2]
    origin = [(-1.0, 0.0 if geometry == "axisymmetric" else -1.0, 0.5)[k] for k in axes]
    return IndexField.from_samples(
        np.full([5] * len(axes), contrast), origin=origin, spacing=[(0.5, 0.75, 1.0)[k] for k in axes],
        geometry=geometry, body=body,
    )  # fmt: skip


# --- radial quadrature -----------------------------------------------------------------------------------------------


def test_radial_points_are_the_substitution_of_even_ones():
    """Evenly spaced t at one offset: u = p(t), ascending, weights p'(t) with the sum of a ray each; seeds differ."""
    squared, weight = radial.radial_points(40, 3, 5)
    assert squared.shape == weight.shape == (3, 40)
    offset = np.random.default_rng(5).random((3, 1))
    t = (np.arange(40) + offset) / 40
    smooth = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    np.testing.assert_allclose(squared, smooth(t), rtol=1e-12)
    np.testing.assert_allclose(weight, smooth.deriv()(t) / smooth.deriv()(t).mean(axis=1, keepdims=True), rtol=1e-11)
    np.testing.assert_allclose(weight.sum(axis=1), 40.0)
    for power in (1, 2, 5):
        np.testing.assert_allclose((weight * squared**power).mean(axis=1), 1.0 / (power + 1), atol=1e-4)
    assert (radial.radial_points(40, 3, 6)[0] != squared).all()


def test_rays_along_a_radius():
    """Each in the middle of an equal share of the area, of a disc and of an annulus; starts, places and weights."""
    for pupil, hole in ((Disc(0.02, (0.1, 0.2, -0.3)), 0.0), (Annulus(0.02, 0.005, (0.1, 0.2, -0.3)), 1 / 16)):
        rays = radial.radial_bundle(pupil, UP, 10)
        offset = rays.position - pupil.center
        np.testing.assert_allclose(offset @ pupil.axes[1], 0.0, atol=1e-15)
        along = offset @ pupil.axes[0] / 0.02
        np.testing.assert_allclose(along**2, hole + (1.0 - hole) * (np.arange(10) + 0.5) / 10, rtol=1e-10)
        assert (rays.direction == UP).all()
        plan = TracePlan("adaptive", "warp", "cpu", "float32", 100, None, 1e-3, ())
        task = PupilTask(box_field(), pupil, UP, Plane(UP, UP), plan, 1e-6, 8, 3, is_radial=True)
        squared, weight = points = task.points(4)
        position, flat, share = radial_rays(task.pupil, points, slice(1, 3))
        place = np.sqrt(hole + (1.0 - hole) * squared[1:3].ravel())
        np.testing.assert_allclose(flat, np.c_[place, 0.0 * place], rtol=1e-13)
        np.testing.assert_allclose(position, pupil.center + 0.02 * place[:, None] * pupil.axes[0], rtol=1e-13)
        np.testing.assert_array_equal(share, weight[1:3].ravel())


def test_what_is_symmetric_about_the_axis():
    """Field, pupil, its centre, its normal and the look, each by itself; off by rounding is on the axis."""
    round_ = box_field("axisymmetric")
    for field, pupil, look, why in (
        (round_, Disc(1.0), UP, None),
        (round_, Disc(1.0, (0.0, 0.5e-9, 0.2)), -UP, None),
        (round_, Annulus(1.0, 0.3), UP, None),
        (box_field("volume"), Disc(1.0), UP, "a volume, not axisymmetric"),
        (box_field("planar"), Disc(1.0), UP, "planar, not axisymmetric"),
        (round_, Rectangle(1.0, 1.0), UP, "Rectangle, not round"),
        (round_, Disc(1.0, (3e-3, 4e-3, 0.0)), UP, "centre is 0.005 m from the axis"),
        (round_, Disc(1.0, (0, 0, 0), (0.0, 0.02, 1.0)), UP, "the pupil's normal makes an angle of 0.02 rad"),
        (round_, Disc(1.0), np.array([np.sin(0.01), 0.0, -np.cos(0.01)]), "look direction makes an angle of 0.01 rad"),
    ):
        found = radial.asymmetry(field, pupil, look)
        assert (found is None) if why is None else (why in found)


def test_how_many_radial_rays_there_are():
    """As asked, from 32 to 512 or the most; the disc where it is asked for, or is as accurate, or has no symmetry."""
    field, disc = box_field("axisymmetric"), Disc(1.0)
    choose = radial.choose_radial
    assert [choose(field, disc, UP, n, 16, "auto")[0] for n in (31, 32, 100, 512, 9999)] == [0, 32, 100, 512, 512]
    assert choose(field, disc, UP, 9999, 16, "auto", 128)[0] == 128
    assert choose(field, disc, UP, 5, 16, True)[0] == 32 and choose(field, disc, UP, 100, 16, np.True_)[0] == 100
    for off in ("off", False, np.False_):
        assert choose(field, disc, UP, 9999, 16, off) == (0, "rays over the whole disc: symmetry is off")
    count, why = choose(field, disc, UP, 1000, 16, "auto")
    assert "16 x 512 rays instead of 16,000 over the disc" in why and count == 512
    assert "at least 512 rays" in choose(field, disc, UP, 5, 16, "auto")[1]
    assert choose(box_field(), disc, UP, 1000, 16, "auto")[0] == 0
    with pytest.raises(ValueError, match="symmetry=True, but the field is a volume"):
        choose(box_field(), disc, UP, 1000, 16, True)
    with pytest.raises(ValueError, match="symmetry must be"):
        choose(field, disc, UP, 1000, 16, "on")
    # 128 rays a replicate where those of all are nearer than 0.75 cells of 0.75 m: 1.7 R / 2048.
    limit = 0.75 * 0.75 * 2048 / 1.7
    assert [radial.fewer_rays(field, Disc(limit * share), 16) for share in (0.99, 1.01)] == [128, 512]


# --- lattices --------------------------------------------------------------------------------------------------------


def test_lattices_are_those_of_neighbouring_fibonacci_numbers():
    """And which of them may be tried: their rays meet every cell and are at most half of those asked for."""
    numbers = [1, 2]
    while numbers[-1] < 30000:
        numbers.append(numbers[-1] + numbers[-2])
    for size, generator in lattices.LATTICES.items():
        assert numbers[numbers.index(size) - 1] == generator
    field = box_field()  # cells of 0.5 m
    shapes = (Rectangle(60.0, 80.0), 4800.0), (Disc(40.0), np.pi * 1600.0), (Annulus(40.0, 20.0), np.pi * 1200.0)
    for pupil, area in shapes:
        for asked in (6250, 20000):
            least = area / (0.75 * 0.5) ** 2 / 16
            expected = tuple(n for n in lattices.LATTICES if least <= n <= 0.5 * asked)
            assert lattices.lattice_sizes(field, pupil, asked, 16, "auto") == expected and len(expected) < 6
            assert lattices.lattice_sizes(field, pupil, asked, 16, "off") == ()
    assert lattices.lattice_sizes(field, Disc(4.0), 6249, 16, "auto") == ()
    with pytest.raises(ValueError, match="'maybe'"):
        lattices.lattice_sizes(field, Disc(4.0), 6249, 16, "maybe")
    assert lattices.smoothed_axes(Disc(1.0).square_map) == 1 and lattices.smoothed_axes(Rectangle(1, 1).square_map) == 3
    assert lattices.may_still_settle({}, 144)
    for error, good in ((3e-6 * (233 / 144) ** 4 * 0.99, True), (3e-6 * (233 / 144) ** 4 * 1.01, False)):
        assert lattices.may_still_settle({144: error}, 233) == good
        assert lattices.may_still_settle({89: 9.0, 144: error}, 233) == good


@pytest.mark.parametrize("smoothed", [0, 1, 2, 3])
def test_points_of_a_lattice(smoothed: int):
    """(i + a) / n and the fraction of i g / n + b, substituted where smoothed, with the weights of the substitution."""
    seeds = np.array([123456789, 4000000000], np.uint32)
    square, weight = lattices.lattice_points(233, smoothed, seeds)
    a, b = (seeds.astype(float) + 0.5) / 2.0**32
    i = np.arange(233)
    expected, factor = np.stack([(i + a) / 233, (i * 144 / 233 + b) % 1.0], axis=1), np.ones(233)
    smooth = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    for axis in (0, 1):
        if smoothed & (1 << axis):
            factor = factor * smooth.deriv()(expected[:, axis])
            expected[:, axis] = smooth(expected[:, axis])
    np.testing.assert_allclose(square, expected, atol=1e-12)
    np.testing.assert_allclose(weight, factor, atol=1e-10)
    assert sorted(lattices.lattice_order(233, False)) == sorted(lattices.lattice_order(233, True)) == list(range(233))
    rings = lattices.lattice_order(233, False) * 3 // 233  # int(sqrt(233) / 4) rings, one after the other
    assert (np.diff(rings) >= 0).all() and set(rings) == {0, 1, 2}
    for ring in range(3):
        inside = lattices.lattice_order(233, False)[rings == ring]
        assert (np.diff(inside * 144 % 233) > 0).all()
    assert (np.diff(lattices.lattice_order(233, True)) == 1).all()


# --- order and sums --------------------------------------------------------------------------------------------------


def test_points_in_the_order_of_their_digits():
    """Of SciPy's plain Sobol points: by the first coordinate alone, or by rings of it and by the second in each."""
    number, points = np.arange(1024), np.empty((1024, 2))
    points[number ^ number >> 1] = qmc.Sobol(2, scramble=False).random(1024)  # SciPy's are in the order of Gray codes
    order = point_order(1000, True)
    assert order.dtype == np.int32 and (np.diff(points[order, 0]) > 0.0).all() and len(set(order)) == 1000
    order = point_order(1000, False)
    ring = np.floor(points[order, 0] * 2.0 ** int(np.log2(1000) / 2 - 2)).astype(int)
    assert (np.diff(ring) >= 0).all() and len(set(order)) == 1000 and ring.max() == 3
    for one in range(4):
        assert (np.diff(points[order[ring == one], 1]) > 0.0).all()
    assert point_order(1, False).tolist() == [0] and not order.flags.writeable


@pytest.mark.parametrize("seed", [0, 2**31, np.int64(7), 2**64 + 3, 2**128 - 41])
def test_seeds_of_replicates(seed: int):
    """The numbers of NumPy's generator whose key is the seed, in two halves; several threads draw at once."""

    def expected(seed: int) -> np.ndarray:
        return np.random.Philox(key=int(seed)).random_raw(5).astype("<u8").view("<u4").reshape(5, 2)

    seeds = [seed + number for number in range(40)]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda seed: replicate_seeds(seed, 5), seeds))
    np.testing.assert_array_equal(found, [expected(seed) for seed in seeds])


def test_seeds_of_replicates_beyond_a_key_and_without_a_seed():
    long = 123456789012345678901234567890**2
    assert np.array_equal(replicate_seeds(long, 3), replicate_seeds(long, 3))
    assert not np.array_equal(replicate_seeds(long, 3), replicate_seeds(long + 1, 3))
    assert not np.array_equal(replicate_seeds(None, 3), replicate_seeds(None, 3))


def test_sums_tell_their_errors():
    """The ratio's standard error is the spread of the replicates' ratios over the root of their number."""
    rng = np.random.default_rng(111)
    moments = np.zeros((5, MOMENT_COUNT))
    moments[:, 0], moments[:, 10], moments[:, 11] = [10.0, 20.0, 0.0, 5.0, 8.0], rng.uniform(size=5), [3, 4, 5, 6, 7]
    phasors = moments[:, 0] * np.exp(1j * rng.normal(size=5)) * rng.uniform(0.5, 1.0, 5)
    sums = PupilSums(moments, phasors, 60)
    ratios = np.where(moments[:, 0] > 0.0, np.abs(phasors) ** 2 / np.maximum(moments[:, 0], 1.0) ** 2, 0.0)
    assert sums.standard_error == pytest.approx(np.std(ratios, ddof=1) / np.sqrt(5.0), rel=1e-12)
    assert sums.evaluation_count == 25 and sums.greatest_error == moments[:, 10].max()
    np.testing.assert_array_equal(sums.total, moments.sum(axis=0))
    assert np.isnan(PupilSums(0.0 * moments, phasors, 60).standard_error)
    plan = TracePlan("adaptive", "warp", "cpu", "float32", 100, None, 1e-3, ())
    task = PupilTask(box_field(), Disc(1.0), UP, Plane(UP, UP), plan, 1e-6, 8, 5)
    moments[:, 10] = [1e-10, 1e-9, 0, 0, 0]
    assert holds_tolerance(moments, task)
    moments[3, 10] = 1.001e-9
    assert not holds_tolerance(moments, task)


def test_groups_of_rays():
    """256 rays a group, 64 groups joined at a time, down to one; the least lattice is one group."""
    assert [group_count(n) for n in (1, min(lattices.LATTICES), 256, 257, 1000)] == [1, 1, 1, 2, 4]
    assert joined_counts(1) == [1] and joined_counts(256 * 64) == [64, 1] and joined_counts(256 * 65) == [65, 2, 1]
    assert joined_counts(256 * 64 * 64 + 1) == [4097, 65, 2, 1]


def test_memory_is_asked_for_before_rays_are_traced():
    """So many bytes a ray in all, 24 of them in one piece."""
    from aerokernels.tracing.launch import RAY_BYTES

    needed = 1000 * RAY_BYTES + 3000 * KEPT_BYTES
    check_memory("cpu", (needed, 24000.0), 1000, 3000)
    for memory in ((needed - 1, 24000.0), (needed, 23999.0)):
        with pytest.raises(ValueError, match="device 'cpu' has"):
            check_memory("cpu", memory, 1000, 3000)


# --- jobs and air ----------------------------------------------------------------------------------------------------


def test_the_plane_beyond_box_and_pupil():
    """Across the look, behind the farthest corner of the box by the pupil's reach and a thousandth of its size."""
    field, size = box_field(), np.sqrt(4.0 + 9.0 + 16.0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 2) for z in (0.5, 4.5)])
    for look in (np.array([0.6, -0.64, 0.48]), np.array([-0.6, 0.64, 0.48]), -UP):
        pupil = Disc(0.3, (0.1, 0.2, 0.3))
        plane = plane_beyond(field, pupil, look)
        farthest = max(((corners - pupil.center) @ look).max(), 0.0)
        assert (plane.point - pupil.center) @ look == pytest.approx(farthest + 0.3 + 1e-3 * size, rel=1e-12)
        np.testing.assert_allclose(np.cross(plane.point - pupil.center, look), 0.0, atol=1e-12)
        np.testing.assert_allclose(plane.normal, look)
    behind = plane_beyond(field, Disc(0.3, (0.0, 0.0, 9.0)), UP)  # the box is behind the pupil
    assert behind.point[2] == pytest.approx(9.0 + 0.3 + 1e-3 * size)
    flat = plane_beyond(box_field("planar"), Disc(0.3, (5.0, 0.0, 0.0)), UP)
    assert flat.point[0] == 5.0 and flat.point[2] == pytest.approx(4.5 + 0.3 + 5e-3)
    _check_size(field, Disc(4.99 * size))
    with pytest.raises(ValueError, match="hardly any ray meets the field"):
        _check_size(field, Disc(5.01 * size))


def test_rays_that_end_on_a_body():
    """Those that enter it in the box, or begin in it and leave it beyond; not those that begin in it and come out."""
    body = Body([[-0.5, 1.5], [0.5, 1.5], [0.5, 2.5], [-0.5, 2.5]], "planar")
    long = Body([[-0.5, -9.0], [0.5, -9.0], [0.5, 9.0], [-0.5, 9.0]], "planar")
    start = np.array(
        [[0, 0, -1.0], [0, 1.0, -1.0], [0, 0, 2.0], [0, 0, 3.0], [0, 0, 3.0], [0, 9.0, 0.0], [0.0, 0, 2.0]]
    )
    way = np.array([UP, UP, UP, UP, -UP, UP, [1.0, 0.0, 0.0]])
    found = meets_wall(box_field("planar", body=body), start, way)
    assert found.tolist() == [True, False, False, False, True, False, False]
    inside = meets_wall(box_field("planar", body=long), start, way)
    assert inside.tolist() == [True, False, True, True, True, False, False]


def test_the_share_of_a_pupil_that_loses_air():
    """A box 4 m long, cut 3.5 m along: c times half a metre, and all of it for those beside the cut at x = 0.5 m."""
    whole = box_field(contrast=3e-6)
    field = whole.resample((0.25, 0.75, 0.5), region=((-1.0, -1.0, 0.5), (0.5, 2.0, 4.0)))
    pupil = Rectangle(2.0, 0.5, (0.0, 0.5, 2.5))
    found = pupil_air(field, pupil, UP, 1e-7)
    assert found.share == pytest.approx(1.0) and found.is_truncated and not found.is_outside
    assert found.place == "at the face z = 4000 mm" and found.past == pytest.approx(0.25, abs=2e-3)
    beside = 0.25  # of the pupil: 2 m of air, the others half a metre
    assert found.lost_rms == pytest.approx(3e-6 * 1.5 * np.sqrt(beside * (1.0 - beside)), rel=0.05)
    some = pupil_air(field, pupil, UP, 2e-6)
    assert some.share == pytest.approx(0.25, abs=0.02) and some.place == "beside the field's box"
    none = pupil_air(field, pupil, UP, 1e-5)
    assert none.share == 0.0 and none.lost_rms == found.lost_rms
    assert pupil_air(whole, pupil, UP, 1e-7).lost_rms == 0.0 == pupil_air(whole, pupil, UP, 1e-7).past
    for share, truncated in ((1.0e-3, False), (1.001e-3, True)):
        assert PupilAir(share, 0.0, "here").is_truncated == truncated
    PupilAir(0.5, 0.0, "here").check(True)
    with pytest.raises(ValueError, match=r"50 % of the pupil.*cut off here.*The pupil itself is outside"):
        PupilAir(0.5, 0.0, "here", True).check(False)
    own = pupil_air(field, pupil, UP, 1e-7, RayBundle([[0.0, 0.0, 2.5]], UP))
    assert own.rays.ray_count == 1 and own.lost_rms == 0.0 and own.share == 1.0
