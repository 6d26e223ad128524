"""Kernels as users have them against those of the tests, which conftest.py has compiled with little optimisation."""

import functools
import json
import os

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import trace
from aerokernels.tracing.leapfrog import LEAST_RAYS

from .backends import FAR, WAVE, field_of, on
from .opencl_stands import run_python

FLAGS = ("AEROKERNELS_WARP_FLAGS", "POCL_EXTRA_BUILD_FLAGS")
PROGRAM = "import json; from tests.tracing.test_compiler_flags import answers; print(json.dumps(answers()))"
BACKENDS = ("warp", "opencl")


def answers() -> dict[str, dict[str, list]]:
    """By backend: OPD [m] in hexadecimal of rays one by one, and of leapfrog."""
    rng = np.random.default_rng(6)
    start = np.c_[rng.uniform(-1e-3, 1e-3, (LEAST_RAYS, 2)), np.full(LEAST_RAYS, -1e-3)]
    rays = RayBundle(start, np.c_[rng.normal(0.0, 0.03, (LEAST_RAYS, 2)), np.ones(LEAST_RAYS)])
    found: dict[str, dict[str, list]] = {}
    for backend in BACKENDS:
        try:
            where = on(f"{backend}-cpu")
        except pytest.skip.Exception:
            continue
        settings = {"until": FAR, "precision": "float64", **where}
        few = trace(field_of("planar", "cubic"), rays[:100], method="adaptive", **settings)
        many = trace(field_of("planar", "cubic"), rays, **settings)
        assert few.ok.all() and many.plan.method == "leapfrog"
        found[backend] = {name: [float(opd).hex() for opd in r.opd] for name, r in (("few", few), ("many", many))}
    return found


@functools.cache
def usual(folder) -> dict[str, dict[str, list]]:
    """The answers of a process of its own, with the flags that users have."""
    done = run_python(PROGRAM, folder, **dict.fromkeys(FLAGS, ""))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_tests_have_flags_of_their_own():
    assert all(os.environ.get(name) for name in FLAGS)


@pytest.mark.parametrize("backend", BACKENDS)
def test_answers_are_those_of_the_usual_flags(backend, tmp_path_factory):
    """Rays one by one: the same bits. Leapfrog, whose sums compilers may reorder: 1e-6 wave."""
    on(f"{backend}-cpu")
    ours, theirs = answers()[backend], usual(tmp_path_factory.getbasetemp())[backend]
    assert ours["few"] == theirs["few"]
    opd = [np.array([float.fromhex(text) for text in found["many"]]) for found in (ours, theirs)]
    assert np.nanmax(np.abs(opd[0] - opd[1])) < 1e-6 * WAVE
