"""Progress bars: shown in terminals and notebooks, once, by the outermost work; elsewhere nothing is written."""

import io
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from aerokernels import Disc, IndexField, look_map
from aerokernels.display import progress


class Terminal(io.StringIO):
    """A terminal that keeps what is written to it."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bars without the second of waiting."""
    monkeypatch.setattr(progress, "WAIT", 0.0)
    monkeypatch.delenv("AEROKERNELS_PROGRESS", raising=False)


def air() -> IndexField:
    samples = 1e-6 * np.random.default_rng(1).random((8, 8, 8))
    return IndexField.from_samples(samples, origin=(-0.01, -0.01, 0.0), spacing=(3e-3,) * 3, geometry="volume")


def mapped(**options) -> None:
    pupil = Disc(radius=2e-3, center=(0, 0, -1e-3))
    look_map(air(), [0.0, 0.01], [0.0, 0.02], pupil, ray_count=64, **options)


@pytest.mark.usefixtures("at_once")
def test_a_terminal_shows_one_bar_and_clears_it(monkeypatch: pytest.MonkeyPatch):
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with progress.progress_bar("outer", wait=0.0) as report:
        report("half", 0.5)
        for _ in progress.tracked("inner", [1, 2, 3]):
            assert not progress.is_watched()
        report("all", 1.0)
    text = screen.getvalue()
    assert "outer" in text and "all" in text and "inner" not in text
    assert progress.is_watched()


@pytest.mark.usefixtures("at_once")
def test_long_work_shows_a_bar_in_a_terminal_alone(monkeypatch: pytest.MonkeyPatch):
    """Nothing where stderr is a file, where it is switched off, or where the caller shows the progress."""
    told: list[tuple[str, float]] = []
    for stream, off, own, expected in (
        (Terminal(), "", None, True),
        (io.StringIO(), "", None, False),
        (Terminal(), "off", None, False),
        (Terminal(), "", lambda text, share: told.append((text, share)), False),
    ):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("AEROKERNELS_PROGRESS", off)
        mapped(progress=own)
        assert ("look angles" in stream.getvalue()) == expected
    assert told[-1] == ("4 of 4 directions", 1.0)


@pytest.mark.usefixtures("at_once")
def test_a_notebook_shows_a_line_that_changes(monkeypatch: pytest.MonkeyPatch):
    lines: list[str] = []
    handle = SimpleNamespace(update=lambda data, raw: lines.append(data["text/plain"]))
    shown = SimpleNamespace(display=lambda data, raw, display_id: handle)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(display=shown))
    monkeypatch.setitem(sys.modules, "IPython.display", shown)
    monkeypatch.setattr(progress, "in_notebook", lambda: True)
    mapped()
    assert lines[-1].startswith("look angles " + 40 * "━" + " 100 % 4 of 4 directions")
