"""Bundles in part: which rows share memory, pilots, cones, rows with their weights, exactly."""

import numpy as np
import pytest

from aerokernels import Disc, RayBundle, Rectangle
from aerokernels.rays import PILOT_RAYS, _rows_or_one, unit_disc_samples

RNG = np.random.default_rng(201)


def bundle(count: int = 20, weight=None) -> RayBundle:
    rng = np.random.default_rng(202)
    return RayBundle(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), weight)


def test_equal_rows_are_one():
    """All rows alike, even where the first, the middle and the last are and another is not; one row is itself."""
    same = np.tile([1.0, 2.0, 3.0], (7, 1))
    assert _rows_or_one(same).tolist() == [[1.0, 2.0, 3.0]] and len(_rows_or_one(same[:1])) == 1
    for row in range(7):
        other = same.copy()
        other[row, 1] = 9.0
        found = _rows_or_one(other)
        np.testing.assert_array_equal(found, other)
        assert found is not other and not np.shares_memory(found, other)


def test_directions_are_scaled_and_units_keep_their_bits():
    """Of any size from 1e-300 to 1e300; a unit vector comes back to the bit, also beside others."""
    way = RNG.normal(size=(6, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    unit = RayBundle(np.zeros((6, 3)), way).direction
    given = unit.copy()
    given[[1, 4]] *= np.array([[1e300], [1e-300]])
    found = RayBundle(np.zeros((6, 3)), given).direction
    np.testing.assert_allclose(found, unit, rtol=1e-15, atol=1e-16)
    np.testing.assert_array_equal(found[[0, 2, 3, 5]], unit[[0, 2, 3, 5]])
    assert np.abs(np.linalg.norm(found, axis=1) - 1.0).max() < 4.5e-16
    parallel = RayBundle(np.zeros((6, 3)), [0.0, 3.0, 4.0])
    assert parallel.direction.shape == (6, 3) and parallel.direction.strides[0] == 0
    assert parallel.direction[5].tolist() == [0.0, 0.6, 0.8]
    assert RayBundle(np.zeros(3), [0.0, 0.0, 2.0]).ray_count == 1


def test_what_is_wrong_is_counted():
    """How many positions or directions are not finite or zero, and which comes first, also of parallel rays."""
    position, direction = np.zeros((5, 3)), np.tile([0.0, 0.0, 1.0], (5, 1))
    position[3, 1], position[4, 0] = np.nan, np.inf
    with pytest.raises(ValueError, match="2 ray positions are not finite, the first is ray 3"):
        RayBundle(position, direction)
    with pytest.raises(ValueError, match="5 ray directions are not finite, the first is ray 0"):
        RayBundle(np.zeros((5, 3)), [0.0, np.nan, 1.0])
    direction[2], direction[4], direction[0] = 0.0, 0.0, [1.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="2 ray directions are zero, the first is ray 2"):
        RayBundle(np.zeros((5, 3)), direction)
    with pytest.raises(ValueError, match="5 ray directions are zero, the first is ray 0"):
        RayBundle(np.zeros((5, 3)), [0.0, 0.0, 0.0])
    for weight in (-np.ones(5), np.zeros(5), np.ones(4), [1.0, np.nan, 1.0, 1.0, 1.0]):
        with pytest.raises(ValueError, match="ray weights"):
            RayBundle(np.zeros((5, 3)), [0.0, 0.0, 1.0], weight)


def test_rows_of_a_bundle():
    """By slices and numbers: with their own shares, or with equal ones; parallel rays share their direction."""
    weight = RNG.uniform(1.0, 2.0, 20)
    rays = bundle(weight=weight)
    np.testing.assert_allclose(rays.weight, weight / weight.sum(), rtol=1e-14)
    for rows in (slice(3, 17, 4), np.array([5, 2, 9])):
        some, equal = rays[rows], rays.rows(rows)
        np.testing.assert_array_equal(some.position, rays.position[rows])
        np.testing.assert_array_equal(equal.direction, rays.direction[rows])
        np.testing.assert_allclose(some.weight, weight[rows] / weight[rows].sum(), rtol=1e-14)
        np.testing.assert_allclose(equal.weight, 1.0 / len(some))
        np.testing.assert_array_equal(rays.part(np.arange(20)[rows]).position, equal.position)
    assert rays[4].ray_count == 1 and rays[4].weight.tolist() == [1.0]
    beam = RayBundle(rays.position, [0.0, 0.6, 0.8]).rows(np.array([1, 7]))
    assert beam.direction.strides[0] == 0 and beam.direction.tolist() == [[0.0, 0.6, 0.8]] * 2
    assert len(bundle()) == 20 == bundle().ray_count and bundle().device is None
    assert not rays.position.flags.writeable and not rays.weight.flags.writeable
    with pytest.raises(ValueError, match="hold no ray"):
        rays.rows(np.array([], int))


@pytest.mark.parametrize("count", [1, 2, PILOT_RAYS, PILOT_RAYS + 1, 3000])
def test_pilots_are_evenly_spread(count: int):
    """All rays up to 512; of more, 512 from the first to the last, no two further apart than their share rounded up."""
    position = np.c_[np.arange(count, dtype=float), np.zeros((count, 2))]
    pilot = RayBundle(position, [0.0, 0.0, 1.0]).pilot
    rows = pilot.position[:, 0].astype(int)
    assert len(rows) == min(count, PILOT_RAYS) and rows[0] == 0 and rows[-1] == count - 1
    if count > 1:
        assert np.diff(rows).min() >= 1 and np.diff(rows).max() <= -(-(count - 1) // (len(rows) - 1))


@pytest.mark.parametrize("half_angle", [0.02, 1.2, np.pi])
def test_cones_are_discs_of_equal_solid_angles(half_angle: float):
    """Each point of the unit disc: 1 - cos = r^2 (1 - cos of the half angle), at its azimuth; weights as the disc's."""
    axis, apex = np.array([0.3, -0.4, 1.2]), np.array([1.0, 2.0, 3.0])
    rays = RayBundle.divergent(apex, axis, half_angle, 60, sampling="gauss", seed=3)
    flat, weight = unit_disc_samples(60, "gauss", 3)
    normal = axis / np.linalg.norm(axis)
    np.testing.assert_allclose(
        rays.direction @ normal, 1.0 - np.sum(flat**2, axis=1) * (1.0 - np.cos(half_angle)), atol=1e-14
    )
    across = rays.direction - (rays.direction @ normal)[:, None] * normal
    angle = np.arctan2(flat[:, 1], flat[:, 0])
    size = np.linalg.norm(across, axis=1)
    kept = size > 1e-6
    cosines = (across @ across[kept][0])[kept] / (size[kept] * size[kept][0])
    np.testing.assert_allclose(cosines, np.cos(angle - angle[kept][0])[kept], atol=1e-8)
    np.testing.assert_allclose(rays.weight, weight / weight.sum())
    assert (rays.position == apex).all()
    for bad in (0.0, -0.1, 3.2):
        with pytest.raises(ValueError, match="half_angle must lie in"):
            RayBundle.divergent(apex, axis, bad)


def test_beams_through_pupils():
    """Along the normal or a direction; from a point through the pupil's points, or from these to the point."""
    pupil, point = Rectangle(0.3, 0.2, (0.1, 0.2, 0.5), (0.0, 0.6, 0.8)), np.array([0.0, 0.1, -2.0])
    samples, weight = pupil.sample(64, "sobol", 5)
    beam = RayBundle.collimated(pupil, 64, seed=5)
    np.testing.assert_array_equal(beam.position, samples)
    np.testing.assert_allclose(beam.direction, np.tile(pupil.normal, (64, 1)), atol=1e-15)
    tilted = RayBundle.collimated(pupil, 64, direction=[0.0, 3.0, 4.0], seed=5)
    np.testing.assert_allclose(tilted.direction[9], [0.0, 0.6, 0.8])
    out, back = (RayBundle.through(pupil, point, 64, seed=5, toward_point=one) for one in (False, True))
    line = samples - point
    np.testing.assert_allclose(out.direction, line / np.linalg.norm(line, axis=1)[:, None], rtol=1e-12)
    np.testing.assert_allclose(back.direction, -out.direction, rtol=1e-12)
    assert (out.position == point).all() and (back.position == samples).all()
    np.testing.assert_allclose(out.weight, weight)
    assert RayBundle.collimated(Disc(1.0)).ray_count == 1024
