"""Objects show themselves in a few lines, in notebooks too; a saved trace keeps where its rays start."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, RayBundle, flow
from aerokernels.display.shown import described


@pytest.fixture(scope="module")
def field() -> IndexField:
    z = np.linspace(0.0, 1e-2, 17)
    contrast = 1e-5 * np.ones((9, 1)) * np.sin(300.0 * z)
    return IndexField.from_samples(contrast, origin=(0, 0), spacing=(1e-3, 625e-6), geometry="axisymmetric")


def test_reprs_have_few_lines_and_units(field):
    for thing in (field, field.samples, flow.uniform_air(), RayBundle.collimated(Disc(1e-3), 64), Disc(1e-3)):
        lines = repr(thing).splitlines()
        assert lines[0] == type(thing).__name__ and 2 < len(lines) < 14 and max(map(len, lines)) < 120
    assert "  radius: 0.001 m" in repr(Disc(1e-3)) and "64 x 3, " in repr(RayBundle.collimated(Disc(1e-3), 64))
    assert described(np.full(9, np.nan)) == "9, none finite" and described("<a>") == "'<a>'"


def test_notebooks_show_the_same_and_nothing_of_it_as_html():
    assert Disc(1e-3)._repr_html_() == f"<pre>{Disc(1e-3)!r}</pre>"
    assert "<b>" not in flow.uniform_air(1.0, radius=4e-3)._repr_html_()
