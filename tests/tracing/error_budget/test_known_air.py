"""Where the known air ends: statuses, the budget's "truncation", and pupils that are refused.

Set-up of most: a constant contrast c in a box, and as truth the same contrast in a box that goes on. The optical path
of a straight ray is c times the length of its way through the box, so what it loses is c times the way between both
boxes, which is known exactly.
"""

import math
import pickle

import numpy as np
import pytest

from aerokernels import Disc, IndexField, QuadMesh, estimate_strehl, trace
from aerokernels.medium import Body
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus
from aerokernels.tracing.error_budget.budget import SAFETY
from aerokernels.tracing.error_budget.known_air import may_be_lost
from aerokernels.tracing.error_budget.tails import contrast_in
from aerokernels.tracing.lines import FACES, box_span

from ..backends import ENGINES, on
from .known_air_boxes import CONTRAST, GEOMETRIES, HALF, LENGTH, UP, WAVE, box


def fan(count: int = 40, start_z: float = -2e-3, slope: float = 0.4) -> RayBundle:
    """Rays from inside the box, up to a slope to the axis."""
    rng = np.random.default_rng(7)
    position = np.c_[rng.uniform(-2e-3, 2e-3, (count, 2)), np.full(count, start_z)]
    return RayBundle(position, np.c_[rng.uniform(-slope, slope, (count, 2)), np.ones(count)])


def lost(field: IndexField, rays: RayBundle, until) -> np.ndarray:
    """What rays may lose [m], on straight lines, at a tolerance of 1e-3 wave."""
    return may_be_lost(field, rays, until, 1e-3 * WAVE)[0]


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_cells_that_are_long_across_the_rays(geometry):
    """A layer across z that fades toward the faces, exp(-z^2 / w^2), in cells 16 times as long across z as along it.

    Truth: c w sqrt(pi) / 2 erfc(L / 2 w) at each face.
    """
    width = LENGTH / 3.0
    axes = [np.linspace(0.0 if geometry == "axisymmetric" else -HALF, HALF, 3)] * (2 if geometry == "volume" else 1)
    along = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, 33)
    samples = CONTRAST * np.exp(-(((0.0 * np.meshgrid(*axes, along, indexing="ij")[0]) + along) ** 2) / width**2)
    origin, spacing = [axis[0] for axis in (*axes, along)], [axis[1] - axis[0] for axis in (*axes, along)]
    field = IndexField.from_samples(samples, origin=origin, spacing=spacing, geometry=geometry)
    rays = RayBundle([[0.0, 1e-3, -0.02], [0.0, -1e-3, -0.02]], UP)
    truth = CONTRAST * width * math.sqrt(math.pi) * math.erfc(0.5 * LENGTH / width)
    found = lost(field, rays, Plane((0.0, 0.0, 0.02), UP))
    assert (truth < found).all() and (found < 4.0 * truth).all()


# --- rays ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_rays_that_leave_disturbed_air_say_so_and_the_budget_covers_it(geometry, engine):
    """To a plane 6 mm beyond the box, where the air in truth goes on: all have the status, and enough."""
    rays, until = fan(), Plane((0.0, 0.0, 10e-3), UP)
    known = trace(box(geometry), rays, until=until, tolerance=1e-3, **on(engine))
    truth = trace(box(geometry, 4.0), rays, until=until, tolerance=1e-3, **on(engine))
    assert known.ok.all() and (known.status == RayStatus.LEFT_DISTURBED_AIR).all()
    assert (truth.status == RayStatus.OK).all() and truth.error["truncation"] == 0.0
    lost = truth.opd - known.opd
    assert lost.min() > 5e-3 * CONTRAST
    # One box is taken to go on for its own extent: 8 mm and more, beyond which these rays do not go.
    assert (known.truncation >= lost - 1e-3 * WAVE).all()
    assert known.error["truncation"] == pytest.approx(SAFETY * known.truncation.max())
    assert known.error["total"] >= known.error["truncation"] >= lost.max()
    assert known.status_summary() == {"LEFT_DISTURBED_AIR": 40}


@pytest.mark.parametrize("on_mesh", [False, True], ids=["grid", "mesh"])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_the_way_that_is_missing_is_known_to_the_stop(geometry, on_mesh):
    """A plane 0.7 mm beyond the box, an arc 0.3 mm beyond it, a start 0.5 mm ahead of it: c times that, to rounding."""
    field = box(geometry, on_mesh=on_mesh)
    inside, ahead = RayBundle([[0.0, 1e-3, 0.0]], UP), RayBundle([[0.0, 1e-3, -4.5e-3]], UP)
    for rays, until, way in (
        (inside, Plane((0.0, 0.0, 4.7e-3), UP), 0.7e-3),
        (inside, ArcLength(4.3e-3), 0.3e-3),
        (ahead, Plane((0.0, 0.0, 3e-3), UP), 0.5e-3),
        (ahead, Plane((0.0, 0.0, 4.7e-3), UP), 1.2e-3),
    ):
        assert lost(field, rays, until)[0] == pytest.approx(CONTRAST * way, rel=1e-5)
    result = trace(field, ahead, until=Plane((0.0, 0.0, 4.7e-3), UP))
    assert result.status[0] == RayStatus.LEFT_DISTURBED_AIR
    assert result.error["truncation"] == pytest.approx(SAFETY * CONTRAST * 1.2e-3, rel=1e-5)


@pytest.mark.parametrize("on_mesh", [False, True], ids=["grid", "mesh"])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_a_stop_in_the_known_air_loses_nothing(geometry, on_mesh):
    """In the box, on its last face, and a start on its first one."""
    field = box(geometry, on_mesh=on_mesh)
    rays = RayBundle(np.c_[np.zeros(5), np.linspace(-3e-3, 3e-3, 5), np.full(5, -0.5 * LENGTH)], UP)
    for until in (Plane((0.0, 0.0, 1e-3), UP), Plane((0.0, 0.0, 0.5 * LENGTH), UP), ArcLength(7e-3)):
        assert not lost(field, rays, until).any()
    result = trace(field, rays, until=Plane((0.0, 0.0, 0.5 * LENGTH), UP))
    assert (result.status == RayStatus.OK).all() and not result.truncation.any()
    assert result.error["truncation"] == 0.0 < result.error["total"]


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_without_a_stop_rays_leave_what_is_known(geometry):
    """until=None ends on the face of the box, behind which the air is as disturbed."""
    result = trace(box(geometry), fan())
    assert (result.status == RayStatus.LEFT_DISTURBED_AIR).all() and result.ok.all()
    assert result.error["truncation"] >= SAFETY * CONTRAST * 7e-3


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_air_that_fades_out_costs_nothing(geometry):
    """A blob whose contrast at the faces is exp(-64) of its peak: no status and no entry, whatever the stop."""

    def blob(*places):
        return CONTRAST * np.exp(-sum(place**2 for place in places) / (HALF / 8.0) ** 2)

    field = box(geometry, value=blob)
    for until in (None, Plane((0.0, 0.0, 50e-3), UP), ArcLength(30e-3)):
        assert not lost(field, fan(), until).any()
    result = trace(field, fan(), until=Plane((0.0, 0.0, 10e-3), UP))
    assert (result.status == RayStatus.OK).all() and result.error["truncation"] == 0.0


def test_a_tail_counts_by_how_fast_it_falls_off():
    """Contrast exp(-(z + 4 mm) / L), L = 2 mm: beyond z = 4 mm it holds L exp(-4) of it; reported up to twice that."""
    field = box(value=lambda x, y, z: CONTRAST * np.exp(-(z + 4e-3) / 2e-3))
    result = trace(field, RayBundle([[0.0, 0.0, 0.0]], UP), until=Plane((0.0, 0.0, 1.0), UP))
    left = CONTRAST * 2e-3 * np.exp(-4.0)
    # The greatest contrast of two cells, 2 mm, is e times that at the face.
    assert left <= result.truncation[0] < 1.2 * np.e * left


@pytest.mark.parametrize(
    ("geometry", "on_mesh"), [*((geometry, False) for geometry in GEOMETRIES), *((g, True) for g in GEOMETRIES[1:])]
)
def test_a_slanted_stop_is_met_elsewhere_by_rays_that_lost_air_would_have_turned(geometry, on_mesh):
    """Contrast g (y - 2 mm), 0 on the ray, beyond the box as well: an air of the length l turns the ray by g l.

    The stop, d beyond the face and tilted by a, is met with g l (d -+ l / 2) tan a more path: l = d for a ray that
    leaves (the air goes on to the stop), l the way ahead of the box for one that enters it. To second order in g.
    A plane across the ray, an arc and the end of the box lose nothing.
    """
    slope, offset, slant = 1e-3, 2e-3, 0.7
    field = box(geometry, value=lambda *places: slope * (places[-2] - offset), on_mesh=on_mesh)
    inside, ahead = RayBundle([[0.0, offset, 0.0]], UP), RayBundle([[0.0, offset, -4.5e-3]], UP)
    normal = (0.0, np.sin(slant), np.cos(slant))
    for rays, height, expected in (
        (inside, 4.7e-3, 0.5 * 0.7e-3**2),
        (ahead, 3e-3, 0.5e-3 * (7e-3 + 0.25e-3)),
        (ahead, 4.7e-3, 0.5 * 0.7e-3**2 + 0.5e-3 * (8.7e-3 + 0.25e-3)),
        (inside, 3e-3, 0.0),
    ):
        # At the rim of a mesh the contrast is that of its edges: what a plane across the ray loses is taken off.
        found, across = (lost(field, rays, Plane((0.0, offset, height), tilt))[0] for tilt in (normal, UP))
        assert found - across == pytest.approx(slope * expected * np.tan(slant), rel=1e-5, abs=1e-18)
        assert on_mesh or across == pytest.approx(0.0, abs=1e-18)
    for until in (ArcLength(6e-3), None):
        assert on_mesh or lost(field, inside, until)[0] == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_budget_covers_the_drift_of_lost_air(engine):
    """The same prism in a box of twice the length as the truth, to a plane tilted by 0.7, 30 mm off the axis' origin.

    What is missing turns rays by 4e-6, 0.09 um of path at the stop; the contrast on the rays themselves is 0.
    """

    def prism(x, y, z):
        return 1e-3 * (y - 2e-3)

    rays = RayBundle(np.c_[np.linspace(-1e-3, 1e-3, 5), np.full(5, 2e-3), np.full(5, -4e-3)], UP)
    until = Plane((0.0, 0.0, 30e-3), (0.0, np.sin(0.7), np.cos(0.7)))
    known = trace(box(value=prism), rays, until=until, **on(engine))
    truth = trace(box(value=prism, scale=2.0), rays, until=until, **on(engine))
    missed = np.abs(truth.opd - known.opd)
    assert missed.min() > 0.05 * WAVE
    assert (known.status == RayStatus.LEFT_DISTURBED_AIR).all()
    assert missed.max() <= known.truncation.min() <= 10.0 * missed.max()


def test_air_beside_the_box_may_turn_rays_as_well():
    """Contrast g y, a ray 0.5 mm beside the box of 8 mm: g 8 mm tan a times 6 mm or more from the box to the stop."""
    slope, slant, aside = 1e-3, 0.7, HALF + 0.5e-3
    field = box("planar", value=lambda y, z: slope * y)
    rays = RayBundle([[0.0, aside, -10e-3]], UP)
    tilts = ((0.0, np.sin(slant), np.cos(slant)), UP)
    oblique, across = (lost(field, rays, Plane((0.0, aside, 10e-3), tilt))[0] for tilt in tilts)
    least = slope * LENGTH * 6e-3 * np.tan(slant)
    assert across > 0.0 and least <= oblique - across <= 20e-3 / 6e-3 * least


def test_rays_beside_the_box_run_through_unknown_air():
    """Beside a box full of disturbed air: a status as far away as the box is large, none farther off."""
    rays = RayBundle([[0.0, y, -20e-3] for y in (0.0, 4.5e-3, 9e-3, 0.1)], UP)
    result = trace(box("volume"), rays, until=Plane((0.0, 0.0, 20e-3), UP))
    assert list(result.status) == [RayStatus.LEFT_DISTURBED_AIR] * 3 + [RayStatus.OK]
    assert result.truncation[1] == pytest.approx(CONTRAST * LENGTH) and result.truncation[3] == 0.0
    assert (result.opd[1:] == 0.0).all()


@pytest.mark.parametrize(
    ("geometry", "on_mesh"), [*((one, False) for one in GEOMETRIES), ("planar", True), ("axisymmetric", True)]
)
def test_rays_along_a_face_pass_all_of_it(geometry, on_mesh):
    """A Gaussian of 1/e radius 1 mm along z and 4 mm across, cut at 4 mm, and a ray along z, 4.2 mm from the axis.

    At its start nothing is lost: the truth is c sqrt(pi) 1 mm exp(-(4.2/4)^2), on the way past the middle.
    """
    axis = np.linspace(0.0 if geometry == "axisymmetric" else -HALF, HALF, 17)
    axes = (*([axis] * (2 if geometry == "volume" else 1)), np.linspace(-HALF, HALF, 65))
    places = np.meshgrid(*axes, indexing="ij")
    samples = CONTRAST * np.exp(-sum(x * x for x in places[:-1]) / 4e-3**2 - places[-1] ** 2 / 1e-3**2)
    if on_mesh:
        field = IndexField.from_mesh(QuadMesh.structured(*places, geometry), samples)
    else:
        origin, spacing = [axis[0] for axis in axes], [axis[1] - axis[0] for axis in axes]
        field = IndexField.from_samples(samples, origin=origin, spacing=spacing, geometry=geometry)
    rays = RayBundle([[0.0, 4.2e-3, -5e-3]], [UP])
    truth = CONTRAST * np.sqrt(np.pi) * 1e-3 * np.exp(-((4.2 / 4.0) ** 2))
    found = lost(field, rays, Plane((0, 0, 5e-3), UP))[0]
    assert truth <= SAFETY * found <= 10.0 * SAFETY * truth


def test_bent_rays_are_told_by_where_they_ended():
    """A strong lens turns a ray out of the side of the box, to which straight ahead there is the undisturbed end only.

    Without positions among the outputs the straight line is all that is known: OK.
    """

    def prism(x, y, z):
        return 0.05 * (y / HALF) * np.where(z < 2e-3, 1.0, 0.0) + 0.05

    field = box(value=prism)
    rays = RayBundle([[0.0, 3.95e-3, -4e-3]], UP)
    until = Plane((0.0, 0.0, 3.9e-3), UP)
    known = trace(field, rays, until=until)
    assert known.position[0, 1] > 1.01 * HALF and known.status[0] == RayStatus.LEFT_DISTURBED_AIR
    assert trace(field, rays, until=until, outputs=("opd",)).status[0] == RayStatus.OK


def test_a_wall_and_the_axis_are_no_ends_of_known_air():
    """A mesh about a ball: rays from its inside cross the wall; the rim is the outer edge alone, faded out or not."""
    angle, shell = np.linspace(0.0, np.pi, 61), np.linspace(1e-3, 4e-3, 31)
    profile = 1e-3 * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    r, z = np.outer(np.sin(angle), shell), np.outer(np.cos(angle), shell)
    r[[0, -1]] = 0.0
    rays = RayBundle([[2e-4, 1e-4, 0.0], [0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.3]])
    for depth, status in ((2e-4, RayStatus.OK), (1.0, RayStatus.LEFT_DISTURBED_AIR)):
        contrast = CONTRAST * np.exp(-(np.hypot(r, z) - 1e-3) / depth)
        mesh = QuadMesh.structured(r, z, "axisymmetric")
        field = IndexField.from_mesh(mesh, contrast, body=Body(profile))
        result = trace(field, rays, until=Plane((0.0, 0.0, 9e-3), UP))
        assert (result.status == status).all(), result.status_summary()


def test_lines_and_boxes():
    """Entries, exits and faces of a box and of a cylinder, starts inside, on faces, beside and far away."""
    position = np.array([[0, 0, -9e-3], [0, 1e-3, 0], [0, 9e-3, 0], [0, 4e-3, -9e-3], [0, 0, -1e15]])
    direction = np.array([UP, (0, 1, 0), (0, 1, 0), UP, UP])
    for geometry, side in (("volume", "high y"), ("axisymmetric", "r")):
        span = box_span(box(geometry), position, direction)
        assert list(span.meets) == [True, True, False, True, True]
        assert span.enter[:2] == pytest.approx([5e-3, 0.0]) and span.leave[:2] == pytest.approx([13e-3, 3e-3])
        assert [FACES[face] for face in span.exit_face[:2]] == ["high z", side]
        assert FACES[span.entry_face[0]] == "low z" and span.entry_face[1] == -1


def test_results_pickle_with_their_budgets():
    result = trace(box(), fan(), until=Plane((0.0, 0.0, 10e-3), UP), outputs=("opd",))
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.status, result.status) and again.error == result.error


# --- none meets the field --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_rays_none_of_which_meets_the_field_are_refused(geometry):
    """Looking away, aside, in millimetres; one that meets it is enough, and still air has nothing to be met."""
    until = Plane((0.0, 0.0, 1.0), UP)
    for position, direction in (([0, 0, 5e-3], UP), ([0, 9e-3, -1e-2], UP), ([0, 0, -1e-2], (0, 1, 0))):
        rays = RayBundle([position], direction)
        with pytest.raises(ValueError, match=r"no ray of the bundle meets the field.*check the units.*direction"):
            trace(box(geometry), rays, until=until)
        both = RayBundle([position, [0, 0, 0]], [direction, UP])
        assert trace(box(geometry), both, until=until).ok[1]
        still = box(geometry, value=lambda *places: 0.0 * places[0])
        assert trace(still, rays, until=until).opd[0] == 0.0
    refusal = (
        r"no ray of the pupil meets the field.*units \(metres.*position|hardly any ray meets the field; give metres"
    )
    for pupil in (Disc(1e-3, (0, 0, 5e-3)), Disc(4.0, (0, 9.0, -8.0)), Disc(1e-3, (0, 0, -8e-3), (0, 0, -1))):
        with pytest.raises(ValueError, match=refusal):
            estimate_strehl(box(geometry), pupil, ray_count=64)


def test_a_pupil_in_undisturbed_air_is_told_so():
    """Inside the box, but ahead of all that is disturbed there: Strehl ratio 1, and a warning."""
    field = box(value=lambda x, y, z: CONTRAST * 10 * ((np.abs(y) < 2e-3) & (np.abs(x) < 2e-3) & (np.abs(z) < 2e-3)))
    with pytest.warns(UserWarning, match="undisturbed air only.*check the units"):
        seen = estimate_strehl(field.with_interpolation("linear"), Disc(1e-3, (0, 0, 3.1e-3)), ray_count=64)
    assert seen.value == pytest.approx(1.0, abs=1e-12)


def test_a_coarse_grid_does_not_disturb_the_air_at_its_faces():
    """A blob of 0.3 mm that has faded to exp(-100) at the face, resampled at 2 mm: 0 lost, on a mesh as on a grid.

    Between the nodes of the coarse grid the blob reaches the face. Cut through its middle instead, contrast and all
    are those of the source, so what is lost is what the source says, whatever the spacing, to 1 %.
    """

    def blob(y, z):
        return CONTRAST * np.exp(-(((z - 1e-3) / 3e-4) ** 2))

    rays = RayBundle([[0.0, 0.0, -2e-3]], UP)
    y, z = np.meshgrid(np.linspace(-HALF, HALF, 81), np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, 161), indexing="ij")
    grid = IndexField.from_samples(blob(y, z), origin=(-HALF, -4e-3), spacing=(1e-4, 5e-5), geometry="planar")
    for fine in (grid, IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), blob(y, z))):
        coarse = fine.resample(1e-3, region=((-HALF, -3e-3), (HALF, 2e-3))).resample((1e-3, 1.2e-3))
        cut = {step: fine.resample(step, region=((-HALF, -3e-3), (HALF, 1e-3))) for step in (1e-3, 5e-4)}
        assert np.abs(contrast_in(coarse, np.array([[0.0, 0.0, 1.5e-3]]))) > 0.1 * CONTRAST
        assert lost(coarse, rays, None)[0] < 1e-3 * CONTRAST * LENGTH
        assert trace(coarse, rays).status[0] == RayStatus.OK
        one, other = (lost(field, rays, None)[0] for field in cut.values())
        assert one == pytest.approx(other, rel=1e-2) and one > 1e-3 * CONTRAST * LENGTH


@pytest.mark.parametrize("engine", ENGINES)
def test_rays_that_a_rod_holds_have_lost_nothing(engine):
    """A rod of n^2 = n0^2 (1 - a^2 r^2), 50 mm in radius: r(z) = r0 cos(a z) + (slope / a) sin(a z) for small slopes.

    The undisturbed lines leave it sideways, where the contrast is -0.12 beside its surface; the rays do not. An
    axisymmetric grid represents the rod exactly, and so the whole error is a rounding.
    """
    index, a, radius, length = 1.5, 8.0, 0.05, 0.3
    r, z = np.linspace(0.0, radius, 81), np.linspace(0.0, length, 61)
    contrast = index * np.sqrt(1.0 - (a * r[:, None]) ** 2) - index + 0.0 * z
    where = {"origin": (0.0, 0.0), "spacing": (r[1], z[1]), "geometry": "axisymmetric", "ambient_index": index}
    field = IndexField.from_samples(contrast, **where)
    start, slope = np.array([0.0267, 0.009, -0.02]), np.array([0.1, 0.2, -0.15])
    rays = RayBundle(np.c_[start, np.zeros(3), np.full(3, 0.01)], np.c_[slope, np.zeros(3), np.ones(3)])
    assert (np.abs(start + 0.27 * slope) > radius).all() and (np.hypot(start, slope / a) < 0.8 * radius).all()
    found = trace(field, rays, until=Plane((0.0, 0.0, 0.28), UP), wavelength=1e-6, **on(engine))
    assert (found.status == RayStatus.OK).all() and found.error["truncation"] == 0.0
    assert found.error["total"] < 2e-9
