"""Arguments of a wrong kind are answered in words, by one look at all of them; see aerokernels/inputs/arguments.py."""

import warnings

import numpy as np
import pytest

from aerokernels import (
    Annulus,
    Disc,
    IndexField,
    Mask,
    QuadMesh,
    RayBundle,
    Rectangle,
    Scene,
    Wavefront,
    flow,
    schlieren,
    strehl,
    zernike,
)
from aerokernels.flow.exact_field import Vortex
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.lidar import estimate_range
from aerokernels.lidar.pulses import GaussianPulse, HeliosPulse, SampledPulse
from aerokernels.wavefronts.terms import fit_tilt
from tests.draws import argument_draws, refusals

WAVE = np.arange(64) * 1e-10, np.exp(-(((np.arange(64) - 30) / 5.0) ** 2))  # times [s] and a pulse


@pytest.fixture(scope="module")
def field() -> IndexField:
    return IndexField.from_samples(np.zeros((9, 9)), origin=(0, 0), spacing=(1e-3, 1e-3), geometry="planar")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda field: Disc(radius="6 mm"), r"radius must be a number of metres, got '6 mm': give 0\.006 \(in Disc\)"),
        (lambda field: Annulus(1e-2, None), r"inner_radius must be a number of metres, got None \(in Annulus\)"),
        (lambda field: Rectangle(1e-2, 1e-2 + 0j), r"height must be a number of metres, got \(0\.01\+0j\)"),
        (lambda field: Mask(np.ones((3, 3)) * 1j, 1e-3), "weights must be an array of real numbers"),
        (lambda field: Disc(1e-3, center=[0, 0, "z"]), "center must be an array of real numbers of metres, got .*'z'"),
        (lambda field: strehl(np.zeros(3), 905e-9, remove=float), "remove must be names of terms"),
        (lambda field: field.evaluate(np.array([[0, 0, 1j]])), "points must be an array of real numbers"),
        (lambda field: field.resample(1e-3, region=False), "region needs two corners of 2 coordinates"),
        (lambda field: field.resample(1e-3, interpolation=3), "interpolation must be a text, got 3"),
        (lambda field: RayBundle.collimated(6e-3), r"pupil must be a Pupil, got 0\.006"),
        (lambda field: flow.wedge("3", 0.1), "mach must be a number, got '3': give 3"),
        (lambda field: flow.isentropic(1e300), r"mach = 1e\+300 is out of all proportion"),
        (lambda field: flow.shipped(3), "name must be a text"),
        (lambda field: schlieren("mach3"), "field must be a"),
        (
            lambda field: estimate_range(*WAVE, "centroid", template=float),
            "template must be a function .* the class float",
        ),
        (
            lambda field: estimate_range(*WAVE, "centroid", template=[[1.0], [1.0, 2.0]]),
            "template must be a function or an array of real numbers or None, got",
        ),
        (lambda field: zernike.zernike_modes(10**400, 0.0, 0.0), "a whole number of 401 digits"),
        (lambda field: Disc(radius=1e-3, centre=(0, 0, 0)), r"Disc has no argument 'centre': did you mean center\?"),
        (lambda field: schlieren(field, pixels=9), r"line_of_sight has no argument 'pixels': did you mean pixel_count"),
        (lambda field: flow.read(np.ones(3)), "path must be the path of a flow file or case, got ndarray: for arrays"),
        (lambda field: Scene.load(3.0), "place must be a text or a Path"),
        (lambda field: Scene.load("wind-tunnel-static", "target.tilt=0"), "overrides must map dotted keys to values"),
    ],
)
def test_a_mistake_of_kind_is_answered_in_words(field, call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call(field)


MASKED = np.ma.array(np.ones((4, 4)), mask=np.eye(4, dtype=bool))
SQUARE = QuadMesh.structured(*np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij"), "planar")


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("opd", lambda: strehl(MASKED, 905e-9)),
        ("weights", lambda: strehl(np.zeros((4, 4)), 905e-9, weights=MASKED)),
        ("contrast", lambda: IndexField.from_samples(MASKED, origin=(0, 0), spacing=(1, 1), geometry="planar")),
        ("density", lambda: flow.DensityField(SQUARE, MASKED, 1.0)),
        ("weights", lambda: Mask(MASKED, 1e-3)),
        ("opd", lambda: Wavefront(MASKED, np.ones((4, 4)), 1e-3, 905e-9)),
        ("weight", lambda: Wavefront(np.zeros((4, 4)), MASKED, 1e-3, 905e-9)),
        ("points", lambda: Wavefront.from_samples(MASKED[:, :2], np.zeros(4), Disc(1.0), 905e-9)),
    ],
)
def test_masked_numbers_are_refused(name, call):
    """What lies under a mask, a file's fill value mostly, went in as if it were known."""
    with pytest.raises(ValueError, match=f"numbers of {name} are masked"):
        call()
    assert strehl(np.ma.array(np.zeros((4, 4))), 905e-9) == 1.0  # of which nothing is masked


def test_an_index_in_place_of_the_contrast_is_warned_of():
    """Air of n = 1.0003 given as the contrast would be glass of n = 2; lenses of 0.5 and gases of 3e-4 pass."""
    where = {"origin": (0, 0), "spacing": (1e-3, 1e-3), "geometry": "planar"}
    with pytest.warns(UserWarning, match=r"contrast is 1\.0003 to 1\.0003 everywhere: it is n - ambient_index"):
        IndexField.from_samples(np.full((9, 9), 1.0003), **where)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for contrast in (0.5, 3e-4, 0.0, 5.0):
            IndexField.from_samples(np.full((9, 9), contrast), **where)


def test_public_calls_take_foreign_bodies_or_refuse_them_in_words():
    """28 foreign bodies in place of any argument: some forty kinds of plain NumPy messages came through before."""
    for name, (function, given) in argument_draws.calls().items():
        if name not in argument_draws.SLOW:
            assert refusals.attempt(function, given) is None, name
    tally = argument_draws.run(limit=500, seed=1, leave_out=argument_draws.SLOW)
    assert tally.faults == [] and tally.count == 500 and tally.answered > 10 and tally.refused > 300


def test_paths_and_grids_of_files_are_refused_in_words(tmp_path):
    path = tmp_path / "flow.npz"
    np.savez(path, x=np.arange(4.0), y=np.arange(4.0), z=np.arange(4.0), rho=np.ones((4, 4, 4)))
    with pytest.raises(TypeError, match="path must be a text or a Path, got list"):
        flow.contents([])
    with pytest.raises(ValueError, match=r"geometry array.*is not known"):
        flow.read(path, geometry=np.ones(2))
    with pytest.raises(TypeError, match="time must be 'latest', 'first'"):
        flow.read(path, time=np.ones(2))
    with pytest.raises(ValueError, match="spacing must be positive"):
        flow.read(path, spacing=[[1.0, 2.0], [3.0]])


def test_what_is_right_passes_unchanged():
    seen = []

    @checked
    def take(length: float, count: int = 3, *, on: bool = False, points: Numbers | None = None, name: str = "x"):
        """Take a `length`.

        Args:
            length: A length [m].
            count: A count.
            on: A switch.
            points: Some points.
            name: A name.
        """
        seen.append((length, count, on, points, name))
        return length

    assert take(np.float32(2.0)) == 2.0 and take(np.array(2), np.int8(3), on=np.True_, points=[[1], [2]]) == 2
    assert len(seen) == 2 and take.__name__ == "take" and "A length" in take.__doc__
    for wrong in ({"length": True}, {"length": 1.0, "on": "no"}, {"length": 1.0, "points": [[1], [1, 2]]}):
        with pytest.raises(TypeError, match=r"must be .*\(in .*take\)"):
            take(**wrong)
    with pytest.raises(TypeError, match=r"take needs length \(A length \[m\]\)"):
        take()


def test_numbers_that_overflow_on_the_way_are_named():
    @checked
    def product(first: float, second: float):
        if second > 2.0:
            return int(float("nan"))
        return float(10 ** int(400 * first))

    for call in (lambda: product(1.0, 1e-90), lambda: product(0.0, 3.0)):
        with pytest.raises(ValueError, match="product cannot be computed from"):
            call()


@pytest.mark.parametrize(
    ("of", "parameter"),
    [
        (GaussianPulse(5e-9), "time"),
        (HeliosPulse(5e-9), "time"),
        (SampledPulse([0.0, 0.5, 1.0, 0.5, 0.0], 1e-9), "time"),
        (Vortex(0.5, 0.01).temperature_ratio_at, "distance"),
        (Vortex(0.5, 0.01).temperature_ratio_at, "distance"),
        (lambda y: Vortex(0.5, 0.01).density_ratio_at(y, 0.0), "y"),
        (lambda z: Vortex(0.5, 0.01).density_ratio_at(0.0, z), "z"),
        (lambda opd: fit_tilt(opd, np.eye(2)), "opd"),
        (lambda points: fit_tilt(np.zeros(2), points), "points"),
        (lambda weights: fit_tilt(np.zeros(2), np.eye(2), weights), "weights"),
    ],
)
@pytest.mark.parametrize(
    "wrong",
    [["a", "b"], np.array([1.0, None], dtype=object), np.array([1j, 2.0]), {"a": 1.0}],
    ids=["texts", "objects", "complex", "mapping"],
)
def test_arrays_of_another_kind_are_refused_by_their_argument(of, parameter, wrong):
    """Each is refused before NumPy casts it: of a complex array it would drop the imaginary part with a warning."""
    with pytest.raises(TypeError, match=rf"^{parameter} must be .*array of real numbers.* \(in "):
        of(wrong)
