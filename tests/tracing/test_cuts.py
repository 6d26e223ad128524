"""What rays lack because their field was cut from a larger one: against integrals of the source, and traces of it."""

import numpy as np
import pytest

from aerokernels import IndexField, RayBundle, trace
from aerokernels.medium import Body
from aerokernels.tracing import ArcLength, Plane, RayStatus
from aerokernels.tracing.cuts import is_cut, lost
from aerokernels.tracing.lines import FACES, SIDE
from tests.slow import first_of

from .disturbed_boxes import CONTRAST, GEOMETRIES, HALF, LENGTH, UP, box

# The cut part of a box: a face low and the face high along the last axis, and one side.
LOW, HIGH, SIDE_AT = -0.3 * LENGTH, 0.25 * LENGTH, 0.75 * HALF


def waves(*places):
    """A smooth contrast that goes on everywhere, about the mean CONTRAST."""
    return CONTRAST * (1.0 + 0.5 * np.cos(300.0 * places[-1] + 0.4) * np.cos(250.0 * places[-2]))


def parts(geometry: str, on_mesh: bool = False) -> tuple[IndexField, IndexField]:
    """A box of waves, and its part between LOW and HIGH and up to SIDE_AT."""
    whole = box(geometry, value=waves, on_mesh=on_mesh)
    first = 0.0 if geometry == "axisymmetric" else -HALF
    across = [first] if geometry != "volume" else [-HALF, -HALF]
    corners = (*across, LOW), (*([HALF] if geometry == "volume" else []), SIDE_AT, HIGH)
    return whole, whole.resample(2.5e-4, region=corners)


def outside(source: IndexField, cut: IndexField, start, way, length: float, count: int = 20_001) -> float:
    """The integral of the source's contrast along a line [m] where it is outside the box of the cut field."""
    along = (np.arange(count) + 0.5) / count * length
    point = np.asarray(start) + along[:, None] * np.asarray(way)
    local = cut.local_coordinates(point)
    inside = np.all((local >= cut.samples.low) & (local <= cut.samples.high), axis=1)
    return float(np.where(inside, 0.0, source.contrast_at(point)).sum() * length / count)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_only_faces_that_we_cut_are_cuts(geometry):
    """Those at which the region ends before the source's box does, also in a chain; none of an array or of a slice."""
    whole, cut = parts(geometry)
    expected = {"low z", "high z", "r" if geometry == "axisymmetric" else "high y"}
    assert {FACES[face] for face in range(len(FACES)) if is_cut(cut, face)} == expected
    again = cut.resample(3e-4)
    assert {FACES[face] for face in range(len(FACES)) if is_cut(again, face)} == expected
    slice_of_array = IndexField.from_samples(
        cut.samples.samples, origin=cut.samples.low, spacing=cut.spacing, geometry=geometry
    )
    for field in (whole, whole.resample(5e-4), slice_of_array):
        assert not any(is_cut(field, face) for face in range(len(FACES)))
    if geometry != "axisymmetric":
        assert not is_cut(cut, SIDE)


@pytest.mark.parametrize("on_mesh", [False, True])
@pytest.mark.parametrize("geometry", first_of(["axisymmetric", "planar", "volume"]))
def test_what_is_lost_is_the_integral_of_the_source_outside(geometry, on_mesh):
    """Random lines, into the box, out of it, through it and beside it, to a plane, a length, or without end."""
    if on_mesh and geometry == "volume":
        pytest.skip("meshes have two axes")
    whole, cut = parts(geometry, on_mesh)
    rng = np.random.default_rng(5)
    start = rng.uniform(-1.5 * HALF, 1.5 * HALF, (40, 3))
    way = rng.normal(size=(40, 3)) * [0.2, 0.5, 1.0]
    way /= np.linalg.norm(way, axis=1)[:, None]
    rays = RayBundle(start, way)
    plane = Plane((0.0, 0.0, 0.45 * LENGTH), UP)
    height = (0.45 * LENGTH - start[:, 2]) / way[:, 2]
    stops = [
        (None, np.full(40, 5.0 * HALF)),
        (ArcLength(0.7 * LENGTH), np.full(40, 0.7 * LENGTH)),
        (plane, np.where(height > 0.0, np.minimum(height, 5.0 * HALF), 5.0 * HALF)),
    ]
    for until, length in stops:
        found = lost(cut, rays, until)
        truth = [outside(whole, cut, *line) for line in zip(start, way, length, strict=True)]
        assert np.abs(found).max() > CONTRAST * HALF
        # The sum over 20,001 places misses a step at a box's face by half a place.
        np.testing.assert_allclose(found, truth, atol=3e-3 * CONTRAST * HALF)
        np.testing.assert_array_equal(lost(whole, rays, until), 0.0)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_traces_are_marked_and_what_they_lack_is_told(geometry):
    """Truth: the source traced whole, to the same plane."""
    whole, cut = parts(geometry)
    rays = RayBundle([[1e-4, y, z] for y in (0.2e-3, 1e-3, 2e-3) for z in (-1.2 * HALF, 0.0)], (0.0, 0.1, 1.0))
    until = Plane((0.0, 0.0, LENGTH), UP)
    found, truth = (trace(field, rays, until=until) for field in (cut, whole))
    assert (found.status == RayStatus.LEFT_DISTURBED_AIR).all() and found.ok.all()
    change = truth.opd - found.opd
    # A cell at the cut is smoothed.
    np.testing.assert_allclose(found.truncation, change, atol=0.04 * np.abs(change).max())
    assert np.abs(change).max() / 3.0 < found.error["truncation"] < 3.0 * np.abs(change).max()
    assert found.error["resampling"] < 0.3 * found.error["truncation"]  # it is no resampling error as well
    assert (truth.status == RayStatus.OK).all() and truth.error["truncation"] == 0.0


def test_loss_has_a_sign():
    """A region that begins behind a layer of less contrast lacks a negative path."""
    whole = box(value=lambda x, y, z: np.where(z < 0.0, -CONTRAST, CONTRAST))
    cut = whole.resample(5e-4, region=((-HALF, -HALF, 0.0), (HALF, HALF, 0.5 * LENGTH)))
    rays = RayBundle([[0.0, 0.0, -LENGTH]], UP)
    assert -CONTRAST * 0.5 * LENGTH < lost(cut, rays, None)[0] < -0.7 * CONTRAST * 0.5 * LENGTH


def test_bent_rays_lose_what_is_ahead_of_their_end():
    """A lens that turns rays by several cells behind which the air is cut: the tangent at the end, not the line."""
    y = np.linspace(-HALF, HALF, 33)
    contrast = np.where(np.arange(65) <= 32, 4e-2, 0.0)[None, :] * (1.0 - (y[:, None] / HALF) ** 2)
    contrast += 2e-3 * (y[:, None] / HALF) * (np.arange(65) > 32)
    whole = IndexField.from_samples(contrast, origin=(-HALF, 0.0), spacing=(2.5e-4, 2.5e-4), geometry="planar")
    cut = whole.resample(2.5e-4, region=((-HALF, 0.0), (HALF, 9e-3)))
    rays = RayBundle([[0.0, y, -1e-3] for y in (-2e-3, 1e-3, 2.5e-3)], UP)
    until = Plane((0.0, 0.0, 16e-3), UP)
    found, truth = (trace(field, rays, until=until, tolerance=1e-2) for field in (cut, whole))
    straight = lost(cut, rays, until)
    error, missed = np.abs(found.opd + found.truncation - truth.opd), np.abs(found.opd + straight - truth.opd)
    assert (error < 0.4 * missed).all()


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_rays_that_end_on_the_body_lose_nothing(geometry):
    """A body across the axis beyond the cut stops some rays; others pass beside it. One that starts in it leaves it."""
    profile = np.array([(0.0, 3e-3), (1e-3, 3e-3), (1e-3, 3.5e-3), (0.0, 3.5e-3)])
    outline = profile if geometry == "axisymmetric" else np.r_[profile, profile[2:0:-1] * [-1.0, 1.0]]
    along, across = np.linspace(-HALF, HALF, 33), np.linspace(0.0 if geometry == "axisymmetric" else -HALF, HALF, 33)
    whole = IndexField.from_samples(
        np.full((33, 33), CONTRAST),
        origin=(across[0], along[0]),
        spacing=(across[1] - across[0], along[1] - along[0]),
        geometry=geometry,
        body=Body(outline, geometry),
    )
    cut = whole.resample(2.5e-4, region=((across[0], -HALF), (HALF, 2e-3)))
    found = lost(cut, RayBundle([[0.0, 5e-4, 0.0], [0.0, 2e-3, 0.0], [0.0, 5e-4, 3.2e-3]], UP), None)
    np.testing.assert_allclose(found, CONTRAST * np.array([0.0, 2e-3, 0.5e-3]), rtol=1e-6, atol=1e-15)
