"""Every public function looks at its arguments before it runs, in the packages beside the top level too."""

import inspect
from importlib import import_module

import numpy as np
import pytest

from aerokernels import compare, echo, flow, simulate
from aerokernels.benches import Picture, measure_shock_angle
from aerokernels.lidar import (
    DetectorChain,
    Digitiser,
    NoiseSources,
    Reflector,
    SampledPulse,
    cramer_rao_range,
    detect,
)

# They hand their options on, to functions that check them.
PASSED_ON = {"available_backends", "contents", "open_series", "prepare_strehl", "read", "sweep"}
TIME = np.arange(128) * 1e-9
PULSE = np.exp(-(((TIME - 50e-9) / 6e-9) ** 2))
MASKED = np.ma.masked_array(PULSE, PULSE > 0.5)
CHAIN = DetectorChain(5000.0, bandwidth=50e6, saturation=0.2, digitiser=Digitiser(8))
PICTURE = Picture(np.eye(8), np.arange(8.0), np.arange(8.0))


@pytest.mark.parametrize("module", ["aerokernels", *(f"aerokernels.{name}" for name in (
    "benches", "compare", "fldi", "flow", "imaging", "lidar", "series", "waves", "zernike"))])  # fmt: skip
def test_public_functions_check_their_arguments(module):
    """Expected: each function of a package's list is wrapped by `checked`, if it takes an argument."""
    package = import_module(module)
    names = getattr(package, "__all__", [])
    functions = {name: getattr(package, name) for name in names if inspect.isfunction(getattr(package, name))}
    taking = {name for name, one in functions.items() if inspect.signature(one).parameters}
    assert {name for name in taking - PASSED_ON if not hasattr(functions[name], "__wrapped__")} == set()


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("power", lambda wrong: detect(TIME, wrong, volts_per_watt=2.0)),
        ("voltage", lambda wrong: cramer_rao_range(TIME, wrong, 0.1)),
        ("samples", lambda wrong: SampledPulse(wrong, 1e-9)),
        ("voltage", lambda wrong: Digitiser(8).record(wrong)),
        ("power", lambda wrong: CHAIN.record(TIME, wrong)),
        ("power", lambda wrong: NoiseSources().density(wrong)),
        ("lobe_cosine", lambda wrong: Reflector(0.5).reflectance(wrong)),
        ("first", lambda wrong: compare.pearson_correlation(wrong, PULSE)),
        ("polar_angle", lambda wrong: flow.cone_shock(3.0, 0.3).density_ratio_at(wrong)),
        ("intensity", lambda wrong: Picture(np.ma.atleast_2d(wrong), np.arange(128.0), np.zeros(1))),
    ],
)
def test_masked_readings_are_refused(name, call):
    """What lies under a mask went in as if it were known: a pulse without its peak gave a range."""
    with pytest.raises(ValueError, match=f"numbers of {name} are masked"):
        call(MASKED)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: flow.mach_after_turn("0.5"), "angle must be a number, got '0.5'"),
        (lambda: compare.correlation_degree("abc"), "correlation must be a number, got 'abc'"),
        (lambda: CHAIN.record(TIME, PULSE, seed=-1), "seed must be a whole number that is not negative, got -1"),
        (lambda: echo("wind-tunnel-mach3"), "scene must be a Scene, got 'wind-tunnel-mach3'"),
        (lambda: simulate("wind-tunnel-static", progress=3), "progress must be a function or None, got 3"),
        (lambda: measure_shock_angle("picture.png", (0.0, 1.0)), "picture must be a PictureView, got 'picture.png'"),
    ],
)
def test_mistakes_of_kind_are_answered_in_words(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


@pytest.mark.parametrize(
    "of",
    [
        flow.cone_shock(3.0, 0.3).density_ratio_at,
        flow.expansion_fan(2.0, 0.2).ratio_of_angle,
        flow.PlaneShock(flow.oblique_shock(3.0, 0.2)).ratio_of_angle,
    ],
)
def test_a_place_that_is_not_known_has_no_density(of):
    """NaN gave the density of undisturbed air, or of the gas at rest; known places keep theirs."""
    places = np.array([0.1, np.nan, 0.4])
    np.testing.assert_array_equal(np.isnan(of(places)), [False, True, False])
    np.testing.assert_array_equal(of(places)[[0, 2]], of(places[[0, 2]]))


def test_single_precision_of_an_argument_is_not_that_of_the_answer():
    """The limits of a digitiser, or a turn, in NumPy's float32 made the codes or the Mach number single."""
    coarse = Digitiser(8, np.float32(-0.5), np.float32(2.0))
    assert coarse.step == Digitiser(8, -0.5, 2.0).step
    assert flow.mach_after_turn(np.float32(0.5)) == flow.mach_after_turn(0.5)
