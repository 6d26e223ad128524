"""How rejected rays are traced again, plans, and chunks: choices that the documents promise, attempt by attempt."""

import dataclasses

import numpy as np
import pytest

from aerokernels import IndexField, Plane, QuadMesh, RayBundle
from aerokernels.tracing import RayStatus, retrace
from aerokernels.tracing.launch import CHUNK, LEAST_CHUNK, RAY_BYTES, chunk_size
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.planning import backend_for, check_choices, make_plan, plan_bundle
from aerokernels.tracing.tableau import (
    BT,
    PAIR,
    PATH_ERROR_SLOPE,
    PATH_ERROR_VALUE,
    STAGE_MOMENTUM,
    NystromPair,
    has_consistent_gradient,
    hermite_weights,
    stage_integrals,
)

OK, LATE, MISSED, HIT = map(
    int, (RayStatus.OK, RayStatus.TOLERANCE_NOT_MET, RayStatus.STOP_NOT_REACHED, RayStatus.HIT_BODY)
)
PLAN = TracePlan("adaptive", "warp", "cpu", "float32", 100, None, 1e-3, ())


class Attempts:
    """Errors by a law of the attempt's plan, in place of tracing; what was asked for is kept."""

    def __init__(self, status, error, law):
        self.status, self.error, self.law, self.asked = np.array(status), np.array(error, float), law, []

    def __call__(self, chosen, plan):
        self.asked.append((chosen.tolist(), plan))
        for row in chosen:
            self.error[row] = self.law(row, plan)
            self.status[row] = OK

    def run(self, plan, limit=1.0):
        retrace._trace_rejected(self, plan, self.status, self.error, limit)
        return [(rows, one.method, one.precision, one.tolerance / plan.tolerance) for rows, one in self.asked]


def test_rays_above_the_tolerance_are_those_that_arrived_or_may_arrive():
    """Above the limit or not a number, of rays that arrived or missed the stop; without bound of any."""
    status = np.array([OK, OK, LATE, MISSED, HIT, HIT, OK, int(RayStatus.MAX_STEPS)])
    error = np.array([1.0, 1.1, 2.0, 3.0, 3.0, np.inf, np.nan, 9.0])
    assert retrace._rejected(status, error, 1.0).tolist() == [False, True, True, True, False, True, True, False]


def test_powers_bring_estimates_below_the_limit():
    """The least power of a half with some room: error 2^-p below 2^-0.4 of the limit; at least 1."""
    limit = 3e-9
    error = limit * np.array([0.5, 1.0, 2.0**0.59, 2.0**0.61, 2.0**1.59, 2.0**1.61, 100.0, np.inf, np.nan])
    assert retrace._powers(error, limit).tolist() == [1, 1, 1, 2, 2, 3, 8, 1, 1]


def test_attempts_of_error_control():
    """Single precision: float64 by half the tolerance, then by what the estimate shows, three rounds at most."""
    once = Attempts([OK] * 4, [0.5, 2.0, 3.0, 0.9], lambda row, plan: 0.4)
    assert once.run(PLAN) == [([1, 2], "adaptive", "float64", 0.5)]
    slow = Attempts([OK] * 3, [5.0, 5.0, 0.1], lambda row, plan: (5.0, 40.0)[row] * plan.tolerance / PLAN.tolerance)
    found = slow.run(PLAN)
    assert found[0] == ([0, 1], "adaptive", "float64", 0.5)
    # Then errors are 2.5 and 20: powers 2 and 5 of a half on top.
    assert sorted(found[1:]) == [([0], "adaptive", "float64", 0.5**3), ([1], "adaptive", "float64", 0.5**6)]
    never = Attempts([OK], [2.0], lambda row, plan: 1e9)
    asked = never.run(PLAN)
    assert len(asked) == 3 and asked[-1][-1] == 1e-4
    double = dataclasses.replace(PLAN, precision="float64")
    assert Attempts([OK], [5.0], lambda row, plan: 1e9).run(double)[0][-1] == 0.5**3
    assert len(Attempts([OK], [5.0], lambda row, plan: 1e9).run(double)) == 2
    assert Attempts([OK], [0.5], lambda row, plan: 1.0).run(PLAN) == []


def test_attempts_after_even_samples():
    """Rays that leapfrog does not hold are first traced under error control, in the requested precision."""
    plan = dataclasses.replace(PLAN, method="leapfrog", sample_count=36)
    found = Attempts(
        [OK] * 3, [0.5, 2.0, np.inf], lambda row, one: 0.1 if row == 1 else 2.0 * (one.precision == "float32")
    )
    asked = found.run(plan)
    assert asked == [([1, 2], "adaptive", "float32", 1.0), ([2], "adaptive", "float64", 0.5)]
    assert all(one.sample_count == 0 and one.sampling is None for _, one in found.asked)
    cubes = dataclasses.replace(plan, cubes=True)
    found = Attempts([OK] * 3, [0.5, 2.0, np.inf], lambda row, one: 0.5)
    found.run(cubes)
    (first, by_spline), (second, controlled) = found.asked
    assert first == [1] and second == [2] and not by_spline.cubes and by_spline.sample_count == 36
    assert controlled.method == "adaptive"


def test_attempts_along_straight_lines():
    """A straight line remains one, and stops where shorter steps lower its error by less than 30 %."""
    plan = dataclasses.replace(PLAN, method="straight")
    found = Attempts([OK] * 2, [4.0, 4.0], lambda row, one: (3.9, 2.0)[row] * (one.tolerance / PLAN.tolerance) ** row)
    asked = found.run(plan)
    assert {one[1] for one in asked} == {"straight"} and asked[0] == ([0, 1], "straight", "float64", 0.5)
    assert all(0 not in rows for rows, *_ in asked[1:]) and found.error[0] == 3.9


def test_what_is_reported():
    """Nothing without such rays; else a warning and a sentence with their number and the greatest error."""
    assert retrace.report_rejected(PLAN, 0, 10, None, 1e-6) is PLAN
    for greatest, said in (
        (3e-6, "the greatest of them 3 waves"),
        (1.1, "some of them without bound"),
        (None, "waves, though"),
    ):
        with pytest.warns(retrace.ToleranceWarning, match="2 of 10 rays"):
            plan = retrace.report_rejected(PLAN, 2, 10, greatest, 1e-6)
        assert said in plan.reasons[-1]


def test_rays_in_chunks():
    """No more than a quarter of the memory takes, than one piece holds of three doubles a ray, or than there are."""
    assert chunk_size((1e15, 1e15), 1000) == 1000 and chunk_size((1e15, 1e15), 10**9) == CHUNK
    assert chunk_size((1e15, 1e15), 5) == LEAST_CHUNK
    assert chunk_size((4000.0 * RAY_BYTES, 1e15), 10**6) == 1000
    assert chunk_size((1e15, 24000.0), 10**6) == 1000


# --- plans -----------------------------------------------------------------------------------------------------------


def field_of(geometry: str = "volume", interpolation: str = "cubic", count: int = 6) -> IndexField:
    samples = 1e-4 * np.random.default_rng(161).normal(size=[count] * (3 if geometry == "volume" else 2))
    step = (1e-3,) * samples.ndim
    return IndexField.from_samples(
        samples, origin=(0.0,) * samples.ndim, spacing=step, geometry=geometry, interpolation=interpolation
    )


def cells() -> IndexField:
    y, z = np.meshgrid(np.arange(4.0), np.arange(5.0), indexing="ij")
    return IndexField.from_mesh(QuadMesh.structured(y, z), np.full(12, 1e-4), interpolation="cells")


def planned(field: IndexField, method: str, **changes) -> TracePlan:
    choices = {"backend": "warp", "device": "cpu", "precision": "float32", "step": None, "tolerance": 1e-3}
    choices |= {"max_steps": None, "path_length": None, "wavelength": 1e-6, "directions": np.array([[0.0, 0.0, 1.0]])}
    return make_plan(field, method=method, **{**choices, **changes})


def test_choices_left_open_are_filled_in():
    """Error control for "auto", by the reference too; predicted evaluations and errors; every reason in words."""
    field = field_of()
    auto = planned(field, "auto")
    assert auto.method == "adaptive" and auto.predicted_error == 1e-3 and auto.predicted_evaluations > 15.0
    assert "no body: no wall test in the kernel" in auto.reasons and any("a volume" in one for one in auto.reasons)
    assert planned(field, "auto", backend="reference", device=None).method == "adaptive"
    fixed = planned(field, "fixed", step=1e-4)
    assert fixed.predicted_evaluations == pytest.approx(3.0 * np.sqrt(3.0) * 5e-3 / 1e-4)
    assert fixed.predicted_error is None and planned(field, "paper").predicted_error is None
    assert fixed.step == 1e-4 and planned(field, "straight").predicted_evaluations is None
    assert planned(field, "adaptive", max_steps=7).max_steps == 7
    for bad in (0, 1.5):
        with pytest.raises(ValueError, match="max_steps must be a whole number of at least 1"):
            planned(field, "adaptive", max_steps=bad)
    size = np.sqrt(3.0) * 5e-3
    with pytest.raises(ValueError, match="more than 1e8 steps"):
        planned(field, "fixed", step=0.99e-8 * size)
    assert planned(field, "fixed", step=0.99e-8 * size, max_steps=3).max_steps == 3
    assert planned(field, "fixed", step=1.01e-8 * size).max_steps > 10**8
    flat = planned(field_of("planar"), "adaptive").reasons
    assert any("two axes, x is never expanded" in one for one in flat)
    assert any("never expanded to a volume" in one for one in planned(field_of("axisymmetric"), "adaptive").reasons)


def test_cells_are_traced_by_the_reference():
    """Whatever is left open; other backends and methods that step over edges are refused."""
    assert backend_for(cells(), "auto") == backend_for(cells(), "reference") == "reference"
    assert backend_for(field_of(), "auto") == "auto" and backend_for(field_of(), "opencl") == "opencl"
    with pytest.raises(ValueError, match="backend 'warp' does not trace interpolation 'cells'"):
        backend_for(cells(), "warp")
    good = {"precision": "float64", "tolerance": 1e-3, "step": None}
    check_choices(cells(), method="auto", **good)
    for method in ("fixed", "paper"):
        with pytest.raises(ValueError, match="steps over the edges between cells"):
            check_choices(cells(), method=method, **good)
    check_choices(field_of(), method="fixed", **{**good, "step": 1e-4})
    for step in (None, 0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="needs step"):
            check_choices(field_of(), method="fixed", **{**good, "step": step})
    for bad, message in (({"step": 1.0}, "belongs to method 'fixed'"), ({"precision": "half"}, "'half' is not known")):
        with pytest.raises(ValueError, match=message):
            check_choices(field_of(), method="auto", **{**good, **bad})


def test_who_is_sampled_evenly():
    """4096 rays through a cubic grid on a kernel's backend; fewer, other interpolants and the reference are not."""
    field = field_of(count=24)
    rng = np.random.default_rng(162)
    rays = RayBundle(np.c_[rng.uniform(5e-3, 18e-3, (4096, 2)), np.full(4096, -1e-3)], [0.0, 0.0, 1.0])
    until = Plane((0.0, 0.0, 30e-3), (0.0, 0.0, 1.0))
    choices = {"device": "cpu", "precision": "float32", "tolerance": 1e-1}
    choices |= {"max_steps": None, "path_length": None, "wavelength": 1e-6}
    plan = plan_bundle(field, rays, until, backend="warp", **choices)
    assert plan.method == "leapfrog" and plan.sample_count >= 36 and plan.sample_count % 3 == 0
    assert plan_bundle(field, rays[:4095], until, backend="warp", **choices).method == "adaptive"
    choices["device"] = None
    assert plan_bundle(field, rays, until, backend="reference", **choices).method == "adaptive"


# --- the pair's weights ----------------------------------------------------------------------------------------------


def test_weights_of_values_and_slopes_integrate_polynomials():
    """Of degree 7 from 0 to 1 by both; of degree 3 up to each node; the path's rule against the first."""
    value, slope = hermite_weights(PAIR.c)
    nodes = np.array([float(c) for c in PAIR.c])
    for power in range(8):
        total = value @ nodes**power + slope @ (power * nodes ** max(power - 1, 0))
        assert total == pytest.approx(1.0 / (power + 1), rel=1e-12)
    for power in range(4):
        np.testing.assert_allclose(
            stage_integrals(PAIR.c) @ nodes**power, nodes ** (power + 1) / (power + 1), atol=1e-14
        )
    np.testing.assert_allclose(STAGE_MOMENTUM, stage_integrals(PAIR.c))
    np.testing.assert_allclose(PATH_ERROR_VALUE, BT - value, atol=1e-15)
    np.testing.assert_allclose(PATH_ERROR_SLOPE, -slope, atol=1e-15)
    kinds = ("cubic", "linear", "monotone", "bilinear", "bilinear-barron", "idw")
    assert [has_consistent_gradient(kind) for kind in kinds] == [True] * 4 + [False] * 2


@pytest.mark.parametrize("name", ["c", "a", "b", "bt", "b_low", "bt_low"])
def test_a_pair_with_a_wrong_number_is_refused(name: str):
    """Any entry off by a hundredth, except those that no condition sees."""
    whole = dataclasses.asdict(PAIR)
    rows = whole[name]
    places = [(i, j) for i in range(4) for j in range(4)] if name == "a" else [(i, None) for i in range(4)]
    refused = 0
    for i, j in places:
        changed = [list(row) for row in rows] if name == "a" else list(rows)
        if j is None:
            changed[i] += type(rows[i])(1, 100)
        else:
            changed[i][j] += type(rows[i][j])(1, 100)
        given = {**whole, name: tuple(map(tuple, changed)) if name == "a" else tuple(changed)}
        with pytest.raises(ValueError):
            NystromPair(**given)
        refused += 1
    assert refused == len(places)
