"""What a sweep is asked for: keys, values, combinations, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from aerokernels.commands._scene import parse_vary, split_at_commas
from aerokernels.jobs.sweeps.definition import checked_scenes, content_hashes, coordinates, define
from aerokernels.jobs.sweeps.records import Records, check_same
from aerokernels.scene import SceneError

SCENE = "wind-tunnel-mach3"


def test_values_are_split_at_commas_outside_brackets_and_spans_are_spaced():
    assert split_at_commas('["a", "b"],["c"]') == ['["a", "b"]', '["c"]']
    assert parse_vary(["flow.source=mach2, mach3"]) == {"flow.source": ["mach2", "mach3"]}
    tilts = parse_vary(["target.tilt=0 deg:30 deg:4"])["target.tilt"]
    np.testing.assert_allclose(np.degrees(tilts), [0.0, 10.0, 20.0, 30.0], rtol=1e-15)


def test_a_grid_holds_every_combination_the_last_key_fastest():
    definition = define(SCENE, {"flow.source": ["mach2", "mach3"], "target.tilt": ["0 deg", "10 deg", 0.3]})
    assert (definition.dims, definition.shape) == (("flow.source", "target.tilt"), (2, 3))
    cases = definition.cases()
    assert [case["flow.source"] for case in cases] == ["mach2"] * 3 + ["mach3"] * 3
    assert cases[4]["target.tilt"] == pytest.approx(np.radians(10.0), rel=1e-15)
    assert definition.load(cases[5]).target.tilt == 0.3
    found = coordinates(definition)
    assert found["target.tilt"][2] == "rad" and list(found["flow.source"][1]) == ["mach2", "mach3"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"vary": {}}, "nothing to vary"),
        ({"vary": {"target.tilt": []}}, "target.tilt"),
        ({"vary": {"target.tilt": [0.1, 0.1]}}, "twice"),
        (
            {"vary": {"target.tilt": ["1 deg", "2 deg"], "target.distance": [1]}, "together": True},
            "zip needs equally many values",
        ),
        ({"vary": {"target.tilt": [0.1]}, "settings": {"target.tilt": 0.2}}, "both set and varied"),
        ({"vary": {"target.tilt": list(np.linspace(0, 1, 400)), "beam.ray_count": list(range(1, 400))}}, "more than"),
    ],
)
def test_what_makes_no_sweep_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        define(SCENE, **arguments)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"target.titl": [1]}, "target.tilt"),
        ({"target.tilt": ["1 kg", "2 deg"]}, "target.tilt"),
        ({"flow.source": ["mach3", "mach9"], "target.tilt": [0.0, 0.1]}, "mach9"),
    ],
)
def test_a_value_that_no_case_takes_is_refused_and_blamed_on_vary(vary, words):
    with pytest.raises(SceneError, match=words) as fault:
        checked_scenes(define(SCENE, vary))
    assert "(changed)" in str(fault.value)


def test_a_combination_that_makes_no_scene_is_a_failed_case():
    """The mesh's interpolations do not go with the uniform grid, nor the grid's with the mesh; two of four do."""
    definition = define(SCENE, {"grid.route": ["uniform", "mesh"], "grid.interpolation": ["cubic", "idw"]})
    scenes, faults = checked_scenes(definition)
    assert sorted(faults) == [1, 2] and "grid.interpolation" in faults[1]
    assert [scene is None for scene in scenes] == [False, True, True, False]


def test_a_description_tells_sweeps_apart_by_what_differs():
    """The same values in other units are the same sweep."""
    first = define(SCENE, {"target.tilt": ["0 deg", "180 deg"]})
    assert first.described() == define(SCENE, {"target.tilt": [0, "3.141592653589793 rad"]}).described()
    for other, words in (
        (define(SCENE, {"target.tilt": ["0 deg", "20 deg"]}), "target.tilt was"),
        (
            define(SCENE, {"target.tilt": ["0 deg", "180 deg"]}, settings={"target.distance": 2}),
            "target.distance was 1.5",
        ),
        (define("sea-level-mach3", {"target.tilt": ["0 deg", "180 deg"]}), "flow.density was"),
        (define(SCENE, {"target.tilt": ["0 deg", "180 deg"]}, together=True), "mode was"),
    ):
        with pytest.raises(ValueError, match=words):
            check_same(Path("x"), first.described(), other.described())
    with pytest.raises(ValueError, match=r"aerokernels 0\.0\.0"):
        check_same(Path("x"), {**first.described(), "version": "0.0.0"}, first.described())


def test_a_file_that_has_changed_is_noticed(tmp_path):
    file = tmp_path / "flow.vtu"
    file.write_bytes(b"one")
    first = content_hashes(["mach3", str(file)])
    assert list(first) == [str(file)] and content_hashes([str(file)]) == first
    file.write_bytes(b"two")
    assert content_hashes([str(file)]) != first
    assert content_hashes([tmp_path]) != content_hashes([str(file)])
    described = define(SCENE, {"target.tilt": [0.0]}).described()
    with pytest.raises(ValueError, match=r"flow\.vtu has changed"):
        check_same(Path("x"), {**described, "content": first}, {**described, "content": content_hashes([str(file)])})


def test_half_a_line_is_dropped_and_no_case_is_kept_twice(tmp_path):
    """A kill in the middle of a write: the case counts as not done, and what comes next stands on a line of its own."""
    records = Records(tmp_path)
    with records.writing():
        assert records.add(3, {"summary": {"strehl": 0.5}}) and not records.add(3, {"summary": {"strehl": 0.6}})
        records.add(1, {"error": "why"})
    path = tmp_path / "cases.jsonl"
    path.write_bytes(path.read_bytes() + b'{"case": 7, "summ')
    again = Records(tmp_path)
    assert sorted(again.done) == [1, 3]
    with again.writing():
        again.add(7, {"summary": {"strehl": 0.7}})
    done = Records(tmp_path).done
    assert sorted(done) == [1, 3, 7] and done[3]["summary"]["strehl"] == 0.5
    assert path.read_bytes().count(b"\n") == 3
    again.forget_failed()
    assert sorted(Records(tmp_path).done) == [3, 7]
