"""What holds in every medium: what a ray keeps along its way, and the error at the default tolerance."""

import numpy as np
import pytest

from aerokernels.tracing import ArcLength, trace
from tests.slow import first_of

from .checks import assert_float64, case
from .closed_forms import Case
from .media import CASES

TIGHT = {"precision": "float64", "tolerance": 1e-6}


def shares(medium: Case) -> np.ndarray:
    """Lengths along the rays, up to where the shortest of them ends."""
    return medium.ends.arc_length.min() * np.array([0.06, 0.5, 0.98])


def launch(medium: Case) -> np.ndarray:
    """The momenta n l with which the rays start, shape (ray_count, 3)."""
    return medium.index(medium.rays.position)[:, None] * medium.rays.direction


def momenta(medium: Case, lengths):
    """Position and momentum n l of the rays, shapes (ray_count, 3), after some lengths, by the exact index there."""
    for length in lengths:
        result = trace(medium.field, medium.rays, until=ArcLength(length), **TIGHT)
        assert result.ok.all()
        yield result.position, medium.index(result.position)[:, None] * result.direction


@pytest.mark.parametrize("name", first_of(["exponential planar", "parabolic planar", "sech planar"]))
def test_level_momentum_in_layers(name):
    """In n(y), n l_x and n l_z are kept. The tracer keeps T_z to rounding, so n l_z also says that |T| is the exact n.

    Errors: n is the exact one, the tracer's is the interpolant's, 1e-10 off; the place, 2e-9 of the path times the
    slope of n. Tolerance: 1e-8.
    """
    medium = case(name)
    before = launch(medium)
    for _, momentum in momenta(medium, shares(medium)):
        assert np.abs((momentum - before)[:, [0, 2]]).max() < 1e-8


@pytest.mark.parametrize(
    ("name", "allowed"),
    first_of(
        [
            ("linear axisymmetric", 1e-11),
            ("fish-eye axisymmetric", 3e-9),
            ("spherical p=-1 axisymmetric", 3e-9),
            ("parabolic axisymmetric", 1e-11),
            ("parabolic volume", 1e-11),
        ],
        3,
    ),
)
def test_skewness_about_an_axis(name, allowed):
    """In n(r, z), on a grid of r and z or in a volume, the skewness n (x l_y - y l_x) is kept.

    Errors: steps, 1e-12; the grid's, where the potential is no parabola (see cases.py). Tolerance, absolute: 1e-11, and
    3e-9 where the grid counts; n0 is 1.5 and distances are below 1 m.
    """
    medium = case(name)
    start, before = medium.rays.position, launch(medium)
    skewness = start[:, 0] * before[:, 1] - start[:, 1] * before[:, 0]
    assert np.abs(skewness).max() > 1e-3
    for place, momentum in momenta(medium, shares(medium)):
        after = place[:, 0] * momentum[:, 1] - place[:, 1] * momentum[:, 0]
        assert np.abs(after - skewness).max() < allowed


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("Luneburg planar", 1e-11),
        ("Luneburg axisymmetric", 1e-11),
        ("Luneburg volume", 1e-11),
        ("fish-eye planar", 3e-9),
        ("fish-eye axisymmetric", 3e-9),
        ("spherical p=-1 planar", 3e-9),
        ("spherical p=-1/2 axisymmetric", 3e-9),
        ("spherical p=2 volume", 3e-9),
    ],
)
def test_bouguer_about_a_centre(name, allowed):
    """In n(|r|) the vector r x n l is kept: its length is n r sin(psi), its direction the plane of the ray.

    Errors and tolerances as for the skewness.
    """
    medium = case(name)
    before = np.cross(medium.rays.position, launch(medium))
    assert np.abs(before).max() > 0.1
    for place, momentum in momenta(medium, shares(medium)):
        assert np.abs(np.cross(place, momentum) - before).max() < allowed


@pytest.mark.parametrize("name", first_of(["Luneburg volume", "fish-eye axisymmetric", "exponential planar"]))
def test_path_and_momentum_are_integrals_of_the_index(name):
    """Optical path = integral of n ds and n l = its start + integral of grad n ds, by 24 Gauss points along each ray.

    None of it rests on a closed form of the ray. Errors: Gauss points, below 1e-12; places, 1e-9 of the path; grad n,
    by central differences of the exact index over 2e-4, 2e-9 of its third derivative. Tolerance: 3e-9 of the length
    for the path, 3e-8 for the momentum.
    """
    medium = case(name)
    length = 0.98 * medium.ends.arc_length.min()
    node, weight = np.polynomial.legendre.leggauss(24)
    path, push = np.zeros(len(medium.rays)), np.zeros((len(medium.rays), 3))
    for share, (place, _) in zip(weight, momenta(medium, 0.5 * length * (node + 1.0)), strict=True):
        path += 0.5 * length * share * medium.index(place)
        for axis in range(3):
            step = 1e-4 * np.eye(3)[axis]
            push[:, axis] += 0.5 * length * share * (medium.index(place + step) - medium.index(place - step)) / 2e-4
    result = trace(medium.field, medium.rays, until=ArcLength(length), **TIGHT)
    assert np.abs(result.optical_path - path).max() < 3e-9 * length
    gain = medium.index(result.position)[:, None] * result.direction - launch(medium)
    assert np.abs(gain - push).max() < 3e-8 * length


@pytest.mark.usefixtures("both_backends")
@pytest.mark.parametrize("name", list(CASES))
def test_default_tolerance(name):
    """Every medium at the default tolerance, 1e-3 wave, in float64: within 1e-8 of the path in all outputs.

    Paths are 0.6 to 8 m, so that 9e-10 m of optical path is 1.5e-9 of them at most; position and direction are
    controlled as far as they matter for the optical path, and the grid adds its few 1e-9 (see cases.py).
    """
    assert_float64(case(name), 1e-8)
