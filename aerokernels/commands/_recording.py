"""Labels and live status of `aerokernels record`."""

import re
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from aerokernels.commands._output import Screen, output, silence
from aerokernels.display.plain_text import plain

if TYPE_CHECKING:
    from aerokernels.hardware.recorder import RecordingStatus

_RATE_TIME = 5.0  # [s] over which the displayed rate is averaged


def parse_labels(pairs: list[str]) -> dict[str, str]:
    """Parse "key=value" texts into labels.

    Raises:
        ValueError: a text without a key or without "=", a text that is not Unicode, or a key given twice.
    """
    labels: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not key or not equals:
            raise ValueError(f"--label {pair!r}: give key=value, for example mach=3")
        if re.search(r"[\ud800-\udfff]", pair):  # bytes of the command line that are no UTF-8
            raise ValueError(f"--label {pair!r}: contains bytes that are not UTF-8; type the label again")
        if key in labels:
            raise ValueError(f"--label {pair!r}: {key!r} is given twice; give each key once")
        labels[key] = value
    return labels


def describe(status: "RecordingStatus", rate: float | None = None) -> str:
    """Describe on one line what is stored on the disk; with `rate`, also the recent echoes per second."""
    parts = [f"stored {status.stored_count}"]
    if status.last_sequence is not None:
        parts.append(f"last sequence {status.last_sequence}")
    if rate is not None:
        parts.append(f"{rate:.1f}/s")
    if status.last_peak is not None:
        parts.append(f"last peak {status.last_peak:.3f} V")
    parts.append(f"damaged {status.damaged_count}")
    parts.append(f"missing {status.missing_count}")
    if status.duplicate_count:
        parts.append(f"sent twice {status.duplicate_count}")
    if status.waiting_count:
        parts.append(f"{status.waiting_count} wait for the store, which another program keeps locked")
    if status.reconnect_count:
        parts.append(f"reconnected {status.reconnect_count}")
    if rate is not None:
        parts.append(f"port {status.port_state}" if status.port_open else f"port away: {status.port_state}")
    return ", ".join(parts)


class RateMeter:
    """Echoes per second over the last seconds."""

    def __init__(self) -> None:
        """Start without counts."""
        self._seen: deque[tuple[float, int]] = deque()

    def rate(self, stored_count: int) -> float:
        """Record a count and return the rate [1/s]."""
        now = time.monotonic()
        self._seen.append((now, stored_count))
        while now - self._seen[0][0] > _RATE_TIME:
            self._seen.popleft()
        since, first = self._seen[0]
        return (stored_count - first) / (now - since) if now > since else 0.0


@contextmanager
def reporter() -> Iterator[Callable[["RecordingStatus"], None]]:
    """Yield a function that shows a status: live on a terminal, elsewhere as a line where something has changed.

    A change of the port is printed at once, changed counts once a second. With --quiet or --json nothing is shown.
    """
    if output.quiet or output.as_json:
        yield lambda status: None
        return
    from rich.console import Console
    from rich.text import Text

    screen: Any = Screen(sys.stdout)
    console, meter = Console(file=screen), RateMeter()
    if console.is_terminal:
        with console.status("waiting for the first echo") as live:
            yield lambda status: live.update(
                Text(plain(describe(status, meter.rate(status.stored_count))), no_wrap=True, overflow="ellipsis")
            )
        return
    shown_at = -1.0
    shown: RecordingStatus | None = None

    def tell(status: "RecordingStatus") -> None:
        nonlocal shown_at, shown
        rate, now = meter.rate(status.stored_count), time.monotonic()
        port_changed = shown is not None and (status.port_open, status.reconnect_count) != (
            shown.port_open,
            shown.reconnect_count,
        )
        if status != shown and (port_changed or now - shown_at >= 1.0):
            shown_at, shown = now, status
            try:
                print(plain(describe(status, rate)), flush=True)
            except OSError:  # the reader has left, or the log's disk is full: no reason to stop recording
                silence(sys.stdout)

    yield tell
