"""scripts/flows: the computed region's outer edge at any Mach number."""

import sys
from pathlib import Path

import numpy as np
import pytest

from aerokernels import flow


@pytest.fixture
def model(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts" / "flows"))
    monkeypatch.delitem(sys.modules, "model", raising=False)
    import model

    return model


@pytest.mark.parametrize("mach", [1.5, 1.8, 2.5, 3.7, 5.0, 8.0])
def test_the_bow_shock_stays_inside(model, mach):
    """Set-up: the outer edge at a Mach number. Expected: ahead of Billig's shock, and steeper than the Mach angle."""
    edge, shock = model.outer_edge(mach), flow.bow_shock(mach, 1e-3 * model.NOSE_RADIUS)
    assert edge.stand_off > 1.2e3 * shock.stand_off
    assert edge.asymptote > np.arcsin(1.0 / mach)


def test_shipped_flows_keep_their_edges_and_others_lie_between(model):
    assert all(model.outer_edge(mach) is edge for mach, edge in model.OUTER_EDGE.items())
    assert model.OUTER_EDGE[3.0].apex_radius < model.outer_edge(2.5).apex_radius < model.OUTER_EDGE[2.0].apex_radius
    with pytest.raises(ValueError, match=r"1.5 to 8"):
        model.outer_edge(1.2)
