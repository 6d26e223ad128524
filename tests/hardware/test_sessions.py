"""Numbers of a board in a store: frames that come late fill the gap they left, restarts begin a session."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore


def frame(number: int, clock: int | None = None, value: int = 0) -> EchoFrame:
    time = 1000 * number if clock is None else clock
    return EchoFrame(number % 2**32, time, 250, 1e-3, 0.0, np.arange(16) + value)


def recorded(path: Path, frames: list[EchoFrame], commit_each: bool) -> tuple:
    """Return sessions by number, gaps, and the missing count, after one recording of the frames."""
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {})
        for one in frames:
            store.add(one, 0)
            if commit_each:
                store.commit()
        store.commit()
        sessions = {echo.frame.sequence: echo.session for echo in store.echoes()}
        gaps = sorted((gap.after_sequence, gap.before_sequence, gap.missing_count) for gap in store.gaps())
        return sessions, gaps, store.missing_count


@pytest.mark.parametrize("commit_each", [False, True])
def test_frames_in_any_order_leave_no_gap(tmp_path: Path, commit_each: bool):
    """Set-up: frame 0, then 1 to 4 in each of their 24 orders, then 5. Nothing is missing, and nothing was restarted.

    Before, 0 1 3 2 4 5 gave two sessions and two missing numbers.
    """
    for number, order in enumerate(permutations(range(1, 5))):
        frames = [frame(0), *map(frame, order), frame(5)]
        sessions, gaps, missing = recorded(tmp_path / f"{number}.sqlite", frames, commit_each)
        assert set(sessions.values()) == {1} and len(sessions) == 6, order
        assert not gaps and missing == 0, order


@pytest.mark.parametrize("commit_each", [False, True])
def test_a_late_frame_divides_its_gap(tmp_path: Path, commit_each: bool):
    """0, then 10, then 4: what is missing is 1 to 3 and 5 to 9; over the wrap of the numbers too."""
    for first in (0, 2**32 - 6):
        frames = [frame(first + k, 1000 * k) for k in (0, 10, 4)]
        sessions, gaps, missing = recorded(tmp_path / f"{first}.sqlite", frames, commit_each)
        ends = [(first + k) % 2**32 for k in (0, 4, 10)]
        assert set(sessions.values()) == {1} and missing == 8
        assert gaps == sorted([(ends[0], ends[1], 3), (ends[1], ends[2], 5)])


def test_a_restarted_board_is_no_late_frame(tmp_path: Path):
    """Its number fits into a gap, its clock does not; or the gap is that of an earlier session."""
    frames = [frame(0, 5_000), frame(9, 14_000), frame(4, 100), frame(6, 2_100), frame(5, 1_100, value=1)]
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("p", "frames", {})
        for one in frames:
            store.add(one, 0)
        store.commit()
        assert [echo.session for echo in store.echoes()] == [1, 1, 2, 2, 2]
        assert [(gap.session, gap.missing_count) for gap in store.gaps()] == [(1, 8)]
        assert store.last_sequence == 6 and store.missing_count == 8
