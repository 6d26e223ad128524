"""The US Standard Atmosphere 1976 against its own tables, and scenes at an altitude and at a Mach number."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from aerokernels import Scene, flow, simulate, sweep

SCENE = "wind-tunnel-mach3"


@pytest.mark.parametrize(
    ("altitude", "temperature", "pressure", "density"),  # geometric; table I of NOAA-S/T 76-1562
    [
        (0.0, 288.150, 1.01325e5, 1.2250),
        (5e3, 255.676, 5.4048e4, 7.3643e-1),
        (11e3, 216.774, 2.2699e4, 3.6480e-1),
        (20e3, 216.650, 5.5293e3, 8.8910e-2),
        (50e3, 270.650, 7.9779e1, 1.0269e-3),
        (80e3, 198.639, 1.0524e0, 1.8458e-5),
    ],
)
def test_the_standard_atmosphere_is_that_of_its_tables(altitude, temperature, pressure, density):
    """Expected: the five digits of the table, to one in the last."""
    air = flow.standard_atmosphere(altitude)
    assert [air.temperature, air.pressure, air.density] == pytest.approx([temperature, pressure, density], rel=1e-4)
    for wrong in (-1.0, 86.1e3, np.nan):
        with pytest.raises(ValueError, match="altitude"):
            flow.standard_atmosphere(wrong)


def test_altitude_scales_the_flow_and_mach_selects_it():
    """Expected: the tabulated density at 5 km around the same flow, said in the provenance; the flow of that Mach."""
    high = Scene.load(SCENE, {"flow.altitude": "5 km"}).density_field()
    assert high.ambient_density == pytest.approx(0.73643, rel=5e-5)
    assert "US Standard Atmosphere 1976 at 5 km" in high.provenance
    point = [[0.0, 1e-3, 5e-4]]
    own = flow.shipped("mach3")
    assert high.density_at(point) / own.density_at(point) == pytest.approx(0.73643 / own.ambient_density, rel=1e-4)
    assert Scene.load(SCENE, {"flow.mach": "4"}).density_field().mach == 4.0
    given = {"flow.source": "cone", "flow.mach": 2.5, "flow.half_angle": "15 deg", "flow.altitude": "11 km"}
    cone = Scene.load(SCENE, given).density_field()
    exact = flow.cone_shock(2.5, np.radians(15.0))
    wall = cone.density_at([[0.0, 0.05 * np.tan(np.radians(15.0) + 1e-9), -0.05]])
    assert wall[0] / 0.3648 == pytest.approx(float(exact.density_ratio_at(exact.half_angle)), rel=5e-5)
    assert "0.3648" in cone.provenance


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({"flow.mach": 2.5}, "choose 2, 3, 4, the shipped flows, or flow.source = 'cone' with flow.half_angle"),
        ({"flow.mach": 3, "flow.source": "static"}, "leave flow.mach out"),
        ({"flow.altitude": "5 km", "flow.density": 0.3}, "drop one"),
        ({"flow.altitude": "90 km"}, "must be at most 86000 m"),
        ({"flow.source": "cone"}, "needs flow.mach, such as 3, and flow.half_angle"),
        ({"flow.source": "cone", "flow.mach": 2, "flow.half_angle": "60 deg"}, "detaches .* give at most 40"),
    ],
)
def test_what_has_no_flow_is_refused_with_the_choices(changes, answer):
    with pytest.raises(ValueError, match=answer):
        Scene.load(SCENE, changes)


def test_named_cases_of_mach_and_altitude_equal_single_runs(tmp_path):
    """Expected: each case is the run of its scene; names label the cases."""
    settings = {"strehl.ray_count": 1000, "beam.ray_count": 16, "receiver.ray_count": 16, "grid.spacing": "0.4 mm"}
    vary = {"name": ["low", "high"], "flow.mach": [2, 4], "flow.altitude": ["0 km", "15 km"]}
    with ThreadPoolExecutor(1) as here:
        found = sweep(SCENE, vary, settings=settings, zip=True, out=tmp_path / "out", executor=here)
    assert found["name"].values.tolist() == ["low", "high"] and not found.failed.values.any()
    single = simulate(Scene.load(SCENE, settings | {"flow.mach": 4, "flow.altitude": "15 km"}))
    assert found.strehl.values[1] == pytest.approx(single.summary["strehl"], abs=2e-4)
    assert found.strehl.values[0] < found.strehl.values[1] - 0.1  # the denser air at the ground
