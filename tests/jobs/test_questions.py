"""Sweeps that answer questions: small runs say what the page says, and the page holds what was written."""

from pathlib import Path

import pytest

from aerokernels.jobs.store import to_json
from aerokernels.jobs.sweeps.case import Stages, make_cases
from aerokernels.jobs.sweeps.dataset import sweep_dataset
from aerokernels.jobs.sweeps.definition import checked_scenes, define
from scripts import questions
from scripts.questions import QUESTIONS, standard_density

ROOT = Path(__file__).resolve().parents[2]
SMALL = {"strehl.ray_count": 256, "receiver.ray_count": 16, "beam.ray_count": 16, "grid.spacing": "0.2 mm"}
ARGUMENTS = {
    "altitude": {"flows": ("mach3",), "kilometres": (15.0,), "settings": SMALL},
    "aperture": {"flows": ("mach3",), "millimetres": (4.0, 12.0), "settings": SMALL},
    "look-angle": {"flows": ("mach3",), "degrees": (0.0, 50.0), "ray_count": 64},
    "tolerance": {"tolerances": (1e-3,), "settings": {**SMALL, "receiver.return_factor": "none"}, "tightest": 1e-4},
}


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch):
    """Sweeps without processes and files of their own, which take longer than these few cases."""
    stages = Stages()

    def sweep(scene, vary, settings=None):
        definition = define(scene, vary, settings=settings)
        scenes, faults = checked_scenes(definition)
        assert not faults
        records = {case.number: to_json({"summary": stages.run(case).summary}) for case in make_cases(scenes)}
        return sweep_dataset(definition, definition.described(), scenes, records, {})

    monkeypatch.setattr(questions, "sweep", sweep)


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_small_run_answers(name: str, in_this_process, tmp_path: Path):
    """Every number that is asked for is there, with its error, and so is the picture."""
    answer = QUESTIONS[name](**ARGUMENTS[name])
    assert "nan" not in answer.text and "unknown" not in answer.text, answer.text
    assert all(one[0].isupper() and one[-1] == "." for one in answer.sentences)
    assert answer.text.count("±") >= 4
    answer.save(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_density_is_the_standard_atmospheres():
    """US Standard Atmosphere 1976, table I, geopotential altitude: 0, 5, 11 and 20 km; its four digits."""
    table = {0.0: 1.2250, 5e3: 0.73612, 11e3: 0.36392, 20e3: 0.088035}
    for height, density in table.items():
        assert abs(standard_density(height) / density - 1.0) < 1e-4
    with pytest.raises(ValueError, match="20 km"):
        standard_density(21e3)
