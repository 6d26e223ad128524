"""Follow the numbers of a board: its sessions, the gaps between its numbers, and frames that come late.

A board counts up, wraps at 2**32, and its clock does not go back; a number or a clock that goes back is that of a board
that was started again, which begins a new session. A frame that comes late goes back in both, too, but its number and
its clock fit into a gap of the session: it belongs there, and the gap is smaller than it seemed.
"""

from collections import deque
from dataclasses import dataclass

from .rows import Gap

MOST_OPEN_GAPS = 64  # latest gaps into which a late frame may fit


@dataclass(frozen=True)
class Followed:
    """An echo as it was followed: its session, number, clock [us] and check sum."""

    session: int
    sequence: int
    device_time: int | None
    crc: int


@dataclass(frozen=True)
class _Gap:
    """Missing numbers between two echoes of a session; `counts` says whether they count as missing in a recording."""

    after: Followed
    before: Followed
    host_time_ns: int
    counts: bool

    @property
    def missing_count(self) -> int:
        return (self.before.sequence - self.after.sequence) % 2**32 - 1

    @property
    def row(self) -> tuple[int, int, int, int, int]:
        ends = self.after.sequence, self.before.sequence
        return self.before.session, *ends, self.missing_count, self.host_time_ns

    def holds(self, sequence: int, device_time: int) -> bool:
        """Whether an echo of this number and clock is one of the missing ones."""
        first, last = self.after.device_time, self.before.device_time
        place = (sequence - self.after.sequence) % 2**32
        return (
            0 < place <= self.missing_count and first is not None and last is not None and first <= device_time <= last
        )


class Sessions:
    """Follows the echoes of one recording.

    Attributes:
        last: the latest echo of the port by its number, None before the first.
        missing_count: numbers missing between the echoes of this recording.
        before_first: gaps before its first echo, which do not count.
        noted: rows of gaps to insert: session, last number before, first number after, count, host time [ns].
        filled: keys of rows to delete first: session, last number before, first number after.
    """

    def __init__(self, last: Followed | None = None) -> None:
        """Go on from the last echo of an earlier recording."""
        self.last = last
        self.missing_count = 0
        self.noted: list[tuple[int, int, int, int, int]] = []
        self.filled: list[tuple[int, int, int]] = []
        self.before_first: set[Gap] = set()
        self._open: deque[_Gap] = deque(maxlen=MOST_OPEN_GAPS)
        self._has_echo = False  # whether this recording has an echo already

    def follow(
        self, sequence: int, device_time: int | None, crc: int, host_time_ns: int, is_known: bool = False
    ) -> int:
        """Return the session of an echo, and note the gap before it or fill the one that it was missing in.

        One that the store has already (`is_known`) and that goes back was sent again, by a board that was not started
        again.
        """
        last = self.last
        session, is_back, ahead = 1, False, 1
        if last is not None:
            session, ahead = last.session, (sequence - last.sequence) % 2**32
            is_back = not 0 < ahead < 2**31
            if device_time is not None and last.device_time is not None:
                is_back = is_back or device_time < last.device_time
        if is_back and device_time is not None:
            for gap in self._open:
                if gap.before.session == session and gap.holds(sequence, device_time):
                    self._fill(gap, Followed(session, sequence, device_time, crc))
                    return session
        if is_back and is_known:
            return session
        here = Followed(session + is_back, sequence, device_time, crc)
        if last is not None and not is_back and ahead > 1:
            self._note(_Gap(last, here, host_time_ns, self._has_echo))
        self._has_echo, self.last = True, here
        return here.session

    def committed(self) -> None:
        """Forget the rows that were written."""
        self.noted.clear()
        self.filled.clear()

    def _note(self, gap: _Gap) -> None:
        self.noted.append(gap.row)
        self._open.append(gap)
        self.missing_count += gap.missing_count if gap.counts else 0
        if not gap.counts:
            self.before_first.add(Gap(*gap.row[:4]))

    def _fill(self, gap: _Gap, here: Followed) -> None:
        self._open.remove(gap)
        self.missing_count -= gap.missing_count if gap.counts else 0
        if gap.row in self.noted:
            self.noted.remove(gap.row)
        else:
            self.filled.append(gap.row[:3])
        for rest in (
            _Gap(gap.after, here, gap.host_time_ns, gap.counts),
            _Gap(here, gap.before, gap.host_time_ns, gap.counts),
        ):
            if rest.missing_count:
                self._note(rest)
