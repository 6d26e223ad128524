"""Random bundles through random fields on both engines: status, end, direction, length and OPD by the reference.

What is drawn and what is held stand in tests/draws.
Each geometry keeps to one precision and one interpolant, so that few kernels are built.
"""

import numpy as np
import pytest

from aerokernels.tracing import trace
from tests.draws import bundle_check
from tests.draws.bundle_check import check
from tests.draws.bundle_draws import WAVE, draw

from ..backends import all_on

pytestmark = pytest.mark.slow

PRECISION = {"volume": "float32", "planar": "float64", "axisymmetric": "float32"}
BUNDLES = 10
# Drawn with few rays: those along the span, whose thousand boxes each cost as much as a whole bundle, and those that
# are mostly traced again. Of the two planar ones along the span, the first takes as long as all others.
FEW, LEFT_OUT = ("spanwise", "mixed"), ("planar", 0)


@pytest.mark.parametrize("kind", ["cpu", pytest.param("gpu", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("geometry", list(PRECISION))
def test_bundles(geometry, kind):
    """No ray of any bundle is beyond its tolerance without a status that says so; one reference for both engines."""
    engines = all_on(kind)
    findings = []
    for seed in range(BUNDLES):
        if (geometry, seed) == LEFT_OUT:
            continue
        chosen = {"geometry": geometry, "precision": PRECISION[geometry], "interpolation": "cubic"}
        case = draw(1000 + seed, **chosen)
        if case.kind["bundle"] in FEW:
            case = draw(1000 + seed, count="300", **chosen)
        try:
            found = check(case, engines, sample=40)[0]
        except ValueError as refusal:  # some draws miss the box with every ray
            assert "meets the field" in str(refusal), case
            continue
        findings += [f"{case}: {f.what} {f.size:.2g} x, {f.text}" for f in found]
    assert not findings, "\n".join(findings)


@pytest.mark.parametrize(
    ("name", "amount", "what"), [("opd", 3e-3 * WAVE, "opd"), ("position", 1e-3, "end"), ("arc_length", 1e-3, "arc")]
)
def test_an_error_that_is_planted_is_found(monkeypatch, name, amount, what):
    """One ray of the engine's answer is shifted: the check names it and nothing else."""
    case = draw(4, interpolation="cubic", tolerance="1e-3", feature="blob", count="300")

    def spoiled(field, rays, **settings):
        result = trace(field, rays, **{**settings, "backend": "reference"})
        if settings["backend"] == "spoiled":
            getattr(result, name)[7] += amount
        return result

    monkeypatch.setattr(bundle_check, "trace", spoiled)
    findings, compared, _ = check(case, [{"backend": "spoiled"}])
    assert compared == 300 and [(f.what, f.ray) for f in findings] == [(what, 7)]


def test_a_seed_says_all():
    """The same seed draws the same case, other seeds others, and what is fixed stays."""
    one, again, other = draw(11), draw(11), draw(12, geometry="planar")
    assert one.kind == again.kind and other.kind["geometry"] == other.field.geometry == "planar"
    assert np.array_equal(one.rays.position, again.rays.position)
    assert np.array_equal(one.field.samples.samples, again.field.samples.samples)
    assert not np.array_equal(one.rays.direction, other.rays.direction)
