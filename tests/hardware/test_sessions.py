"""Numbers of a board in a store: restarts begin a session."""

from pathlib import Path

import numpy as np

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore


def frame(number: int, clock: int | None = None, value: int = 0) -> EchoFrame:
    time = 1000 * number if clock is None else clock
    return EchoFrame(number % 2**32, time, 250, 1e-3, 0.0, np.arange(16) + value)


def test_a_restarted_board_begins_a_session(tmp_path: Path):
    """Its number fits into a gap, its clock does not."""
    frames = [frame(0, 5_000), frame(9, 14_000), frame(4, 100), frame(6, 2_100)]
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("p", "frames", {})
        for one in frames:
            store.add(one, 0)
        store.commit()
        assert [echo.session for echo in store.echoes()] == [1, 1, 2, 2]
        assert [(gap.session, gap.missing_count) for gap in store.gaps()] == [(1, 8), (2, 1)]
        assert store.last_sequence == 6 and store.missing_count == 9
