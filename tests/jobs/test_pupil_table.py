"""A scene's [pupil]: what it makes, what it refuses, and that run, explain and series look through it."""

import math

import numpy as np
import pytest

import aerokernels as ak
from aerokernels.prepare import prepare_field
from aerokernels.pupils import direction_of
from aerokernels.scene import SceneError
from aerokernels.series import look_map
from tests.jobs.test_simulate import CHANGES

TRIANGLE = [["-3 mm", "-3 mm"], ["3 mm", "-3 mm"], ["0 mm", "3 mm"]]


def scene(**pupil) -> ak.Scene:
    return ak.Scene.load("wind-tunnel-mach3", {**CHANGES, **{f"pupil.{key}": value for key, value in pupil.items()}})


@pytest.mark.parametrize(
    ("keys", "kind", "area"),
    [
        ({}, "Disc", math.pi * 36.0),
        ({"diameter": "8 mm"}, "Disc", math.pi * 16.0),
        ({"shape": "annulus", "diameter": "8 mm", "inner_diameter": "4 mm"}, "Annulus", math.pi * 12.0),
        ({"shape": "rectangle", "width": "6 mm", "height": "4 mm"}, "Rectangle", 24.0),
        ({"shape": "rectangle", "width": "6 mm"}, "Rectangle", 36.0),
        ({"shape": "polygon", "vertices": TRIANGLE}, "Polygon", 18.0),
    ],
)
def test_each_shape_is_made_where_it_is_asked_for(keys: dict, kind: str, area: float):
    """Areas [mm2] by hand; the look direction is (sin a cos e, sin e, cos a cos e)."""
    made = scene(**keys, center=["1 mm", "2 mm", "-7 mm"], azimuth="30 deg", elevation="10 deg").view
    assert type(made).__name__ == kind and made.area == pytest.approx(1e-6 * area, rel=1e-12)
    assert made.center == pytest.approx([1e-3, 2e-3, -7e-3], abs=1e-15)
    a, e = math.radians(30.0), math.radians(10.0)
    look = [math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)]
    assert made.normal == pytest.approx(look, abs=1e-15)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"centre": [0, 0, 0]}, "did you mean pupil.center"),
        ({"shape": "square"}, "pupil.shape = 'square': choose one of"),
        ({"width": "3 mm"}, 'pupil.width belongs to shape = "rectangle"'),
        ({"shape": "disc", "height": "2 mm"}, "not to 'disc'"),
        ({"shape": "annulus"}, "needs pupil.inner_diameter"),
        ({"shape": "annulus", "inner_diameter": "20 mm"}, "pupil.inner_diameter, 0.02 m, must be below"),
        ({"shape": "polygon"}, "needs pupil.vertices"),
        ({"shape": "polygon", "vertices": [[0, 0], [1, 1]]}, "three corners or more"),
        ({"shape": "polygon", "vertices": [[0, 0], [1, 1], [2, 2]]}, "enclose nothing"),
        ({"center": ["0 mm", "0 mm"]}, "give 3 lengths"),
        ({"center": ["1 s", 0, 0]}, "is not a length"),
        ({"center": [float("nan"), 0, 0]}, "not finite"),
        ({"elevation": "100 deg"}, "pupil.elevation = '100 deg' must be at most 90 deg"),
        ({"azimuth": "aside"}, "is not an angle"),
        ({"azimuth": 20}, "a number without a unit is in radians: is it '20 deg'?"),
    ],
)
def test_what_makes_no_pupil_is_refused_in_words(keys: dict, words: str):
    with pytest.raises(SceneError, match="pupil") as fault:
        scene(**keys)
    assert words in str(fault.value) and "\n" not in str(fault.value)


def test_a_run_looks_where_the_table_says():
    """The run's ratio is look_map's at these angles, through a part of the flow far wider than the run keeps.

    Both have 4000 rays, sampled differently, and grids of 0.2 mm that lie differently: 3e-4 and 1e-4 apart.
    """
    turned = ak.Scene.load(
        "wind-tunnel-mach3",
        {
            **CHANGES,
            "grid.spacing": "0.2 mm",
            "strehl.ray_count": 4000,
            "pupil": {"azimuth": "20 deg", "elevation": "-15 deg", "diameter": "8 mm"},
        },
    )
    angles = np.radians(20.0), np.radians(-15.0)
    whole = ak.simulate(turned, with_echo=False)
    assert set(whole.failures) == {"echo"}
    wide = ((0.0, -0.03), (0.03, 0.0044))
    field = whole.prepared.mesh_field.resample(turned.grid.spacing, region=wide)
    pupil = ak.Disc(4e-3, (0.0, 0.0, turned.receiver.aperture_z))
    options = {"wavelength": turned.flow.wavelength, "ray_count": 4000}
    expected = look_map(field, [angles[0]], [angles[1]], pupil, **options)
    ahead = look_map(field, [0.0], [0.0], pupil, **options)
    assert whole.strehl.value == pytest.approx(float(expected.strehl[0, 0]), abs=5e-4)
    assert abs(float(ahead.strehl[0, 0]) - whole.strehl.value) > 2e-3  # another direction has another ratio
    # The map's rays and the fan's go the same way: the fan ends along the look direction from where it began.
    way = whole.fan.position[7, -1] - whole.fan.position[7, 0]
    assert way / np.linalg.norm(way) == pytest.approx(direction_of(*angles), abs=1e-4)
    # Sobol points and a square grid.
    assert whole.strehl.opd_rms == pytest.approx(float(np.nanstd(whole.wavefront.opd)), rel=0.03)


def test_a_pupil_that_looks_back_keeps_the_flow_behind_it():
    """Looking along -z from z = -8 mm the part of the flow that is resampled begins where the flow does."""
    back = prepare_field(scene(azimuth="180 deg"))
    assert back.field.box[0][2] <= back.mesh_field.box[0][2] + 1e-3
