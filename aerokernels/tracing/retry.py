"""Trace rejected rays again on the device, right after their chunk and before its results are read.

This is the first attempt of retrace.py, made early: the spline, for rays that polynomials of cubes reject. A ray that
is still above the limit keeps its first results and is left to retrace.py, so results have the same bits with and
without this attempt. The host does not wait for the number of such rays: a fixed number of places is traced, and those
that hold no ray of the chunk hold one far from the field, which takes no samples.
"""

from typing import Any

import numpy as np

from .engines import Prepared
from .result import output_mask

# Most rays of a chunk that are traced again here, or this share of its rays if that is more; the others are left to
# retrace.py. Of the cone scene's incoherent rays one in 200 is rejected.
ROOM, ROOM_SHARE = 1 << 14, 1 / 64  # speed only


def room_for(size: int) -> int:
    """The number of places for chunks of so many rays."""
    return min(size, max(ROOM, int(ROOM_SHARE * size)))


class Retry:
    """Another attempt for the rays that a kernel rejects, on its engine.

    Attributes:
        prepared: The attempt's kernel.
        limit: Error up to which its results are taken [m].
        counted: Error above which the first kernel counts a ray as rejected [m].
        room: Number of places.
        are_far_away: Whether places without a ray hold one far from the field; at first they hold nothing.
    """

    def __init__(self, prepared: Prepared, limit: float, counted: float, room: int):
        """Take the attempt's kernel, for the same outputs as the first one's, and the number of places."""
        engine, self.room = prepared.engine, room
        self.prepared, self.limit, self.counted = prepared, limit, counted
        self.kernels = engine.kernels(("collect_rejected", "deliver_retraced"))
        self.starts = [engine.empty(room, 3), engine.empty(room, 3)]
        self.are_far_away = False
        self.rows, self.count = engine.empty(room, kind=np.int32), engine.empty(1, kind=np.int32)
        self.results = prepared.allocate(room)
        self.requested = output_mask(prepared.outputs)

    def launch(self, first: Prepared, starts: list, results: dict[str, Any], rows: slice) -> None:
        """Start the attempt on some rows of `starts` and `results`, on which the first kernel has been launched."""
        engine = self.prepared.engine
        engine.clear(self.count)
        delivered = [self.count, self.rows, self.results, results, first.rejected, *self.starts]
        if not self.are_far_away:  # without a ray in the list, all places are emptied, and nothing is delivered
            engine.launch(self.kernels["deliver_retraced"], [self.limit, self.requested], delivered, self.room)
            self.are_far_away = True
        listed = [self.rows, self.count, *self.starts]
        given, size = [*starts, results["step_error"], *listed], rows.stop - rows.start
        engine.launch(self.kernels["collect_rejected"], [self.counted, self.room], given, size, rows.start)
        self.prepared.launch(self.starts, self.results, self.room)
        engine.launch(self.kernels["deliver_retraced"], [self.limit, self.requested], delivered, self.room)
