"""The benchmark: its scene and truth are right, its file holds what the docs say, and bad choices are refused."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerokernels.benchmark.measuring import SUITES, UNDISTURBED, Settings, errors
from aerokernels.benchmark.scenes import (
    CONE_AMBIENT,
    CONE_HALF,
    WAVELENGTH,
    cone_contrast,
    cone_field,
    cone_rays,
    cone_truth,
)
from aerokernels.benchmark.suites import SCHEMA, run_bench
from aerokernels.tracing import trace
from aerokernels.tracing.engines.choice import choose_backend

MEASURED = {"median", "standard_error"}


@pytest.fixture(scope="module")
def measured() -> dict[str, Any]:
    """Every suite with few rays on the processor, by what "auto" takes on it."""
    backend, device, _ = choose_backend("auto", "cpu")
    return run_bench(Settings(backends=(backend,), device=device, methods=("adaptive",), ray_count=64, repeats=2))


def test_cone_contrast_is_the_formula():
    """Index 1 + 2.4e-4 (1 + 0.5 tanh((r - a tan 25 deg) / 0.5 mm)); its gradient is that of central differences.

    Error: of n, rounding of 1 + m, 2e-16; of the differences, h^2 m''' / 6 with m''' < 16 * 1.2e-4 / (0.5 mm)^3 and
    h = 0.1 um: 3e-8 per metre, and rounding 1e-19 / 1e-7: nothing; of gradients of 0.24 per metre.
    """
    x, y, z = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 200)) * np.array(CONE_HALF)[:, None]
    index = 1.0 + 2.4e-4 * (1.0 + 0.5 * np.tanh((np.hypot(x, z) - (y + 6e-3) * math.tan(math.radians(25.0))) / 5e-4))
    contrast, gradient = cone_contrast(x, y, z)
    assert np.abs(CONE_AMBIENT + contrast - index).max() < 1e-15
    h = 1e-7
    for axis, step in enumerate(np.eye(3) * h):
        up, down = (cone_contrast(x + s * step[0], y + s * step[1], z + s * step[2])[0] for s in (1.0, -1.0))
        assert np.abs((up - down) / (2.0 * h) - gradient[axis]).max() < 1e-6


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_cone_errors_are_small_at_a_tight_tolerance(precision: str):
    """64 rays through the gridded field against the formula's rays.

    Expected: what cubic interpolation of a tanh of 0.5 mm on 1/16 mm leaves, about (h / w)^4 / 384 = 6e-7 of an OPD of
    one wave, and (h / w)^3 / 24 of its slope, 8e-5 of 200 urad: 0.02 urad. Asked for: 1 urad and 1e-3 wave.
    """
    rays = cone_rays(64)
    truth = cone_truth(rays)
    found = trace(cone_field(), rays, method="adaptive", tolerance=1e-5, precision=precision)
    error = errors(truth, found.direction, found.optical_path - UNDISTURBED, found.ok)
    assert error["ray_count"] == 64 and error["lost_ray_count"] == 0
    assert error["direction_max_urad"] < 1.0 and error["opd_max_waves"] < 1e-3
    # The scene is no trivial one: rays turn by far more, and the OPD is waves.
    assert np.abs(truth.direction[:, :2]).max() > 100e-6
    assert np.ptp(truth.opd) > 0.3 * WAVELENGTH


def test_runs_hold_the_documented_keys(measured: dict[str, Any], root: Path):
    assert json.loads(json.dumps(measured, allow_nan=False)) == measured and measured["schema"] == SCHEMA
    assert {run["suite"] for run in measured["runs"]} == set(SUITES)
    assert measured["machine"].keys() >= {"cpu", "cores", "python", "versions", "devices", "load_average"}
    page = (root / "docs" / "performance-bench.md").read_text(encoding="utf-8")
    for run in measured["runs"]:
        for key in ("kernel_seconds", "wall_seconds", "cpu_seconds"):
            assert run[key].keys() == MEASURED and run[key]["median"] > 0.0 and run[key]["standard_error"] >= 0.0
        assert run["settings"].keys() >= {
            "method",
            "precision",
            "backend",
            "device",
            "tolerance",
            "ray_count",
            "repeats",
        }
        assert run["plan"]["method"] == "adaptive" and run["plan"]["reasons"]
        assert run["rays_traced"] >= 64 and run["evaluations_per_ray"] > 10.0
    for part in (measured, *measured["runs"]):
        for key in part:
            assert f"`{key}`" in page, f"docs/performance-bench.md does not tell of {key}"


def test_cone_run(measured: dict[str, Any]):
    (run,) = (run for run in measured["runs"] if run["suite"] == "cone")
    assert run["rays_traced"] == 64 and run["error"]["ray_count"] == 64
    assert run["error"]["direction_max_urad"] < 1.0 and run["error"]["opd_rms_waves"] < 1e-3


def test_strehl_run(measured: dict[str, Any]):
    """Expected: the fan's value; 64 rays of a smooth wavefront of 0.02 waves rms are good to 1e-2."""
    for run in (run for run in measured["runs"] if run["suite"] == "strehl"):
        assert abs(run["value"] - run["converged_value"]) < 1e-2
        assert run["error"]["value"] == pytest.approx(run["value"] - run["converged_value"])
        assert "total" in run["error"]["budget"]


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"suites": ("cones",)}, ("cones", "strehl")),
        ({"methods": ("fixed",)}, ("fixed", "adaptive")),
        ({"precisions": ("float16",)}, ("float16", "float32")),
        ({"backends": ("cray",)}, ("cray", "warp")),
        ({"repeats": 0}, ("repeats",)),
        ({"ray_count": 3}, ("16",)),
        ({"tolerances": (1e-3, float("nan"))}, ("tolerance",)),
        ({"backends": ("reference",)}, ("reference", "10000")),
    ],
)
def test_choices_that_make_no_sense_are_refused(choices: dict[str, Any], words: tuple[str, ...]):
    with pytest.raises(ValueError) as refused:
        Settings(**choices)
    for word in words:
        assert word in str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("nonsense",), "nonsense"),
        (("cone", "--device", "cuda:99"), "cuda:99"),
        (("cone", "--out", "no/x.json"), "--out"),
    ],
)
def test_the_command_refuses_in_one_line(command_line, arguments: tuple[str, ...], word: str, tmp_path: Path):
    done = command_line("bench", *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and word in done.stderr, done.stderr
    assert not list(tmp_path.iterdir())


def test_the_command_writes_the_file_and_a_table(command_line, tmp_path: Path):
    few = ("--backend", choose_backend("auto", "cpu")[0], "--method", "adaptive", "--rays", 16, "--repeats", 1)
    done = command_line("bench", "cone", *few, "--tolerance", "1", "--tolerance", "1e-4", "--out", "bench.json")
    assert done.returncode == 0, done.stderr
    held = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert held["schema"] == SCHEMA
    made = [(run["settings"]["backend"], run["settings"]["tolerance"]) for run in held["runs"]]
    assert made and {name for name, _ in made} <= {"warp", "opencl"} and len(set(made)) == len(made)
    # Run time against error: a tighter tolerance takes more evaluations and misses less.
    for loose, tight in zip(held["runs"][::2], held["runs"][1::2], strict=True):
        assert (loose["settings"]["tolerance"], tight["settings"]["tolerance"]) == (1.0, 1e-4)
        assert loose["evaluations_per_ray"] < tight["evaluations_per_ray"]
        assert loose["error"]["opd_rms_waves"] > tight["error"]["opd_rms_waves"]
    assert [line.split("\t")[0] for line in done.stdout.splitlines()[:2]] == ["suite", "cone"]
