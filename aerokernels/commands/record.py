"""`aerokernels record`: log echoes from a serial port into a store."""

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from aerokernels.hardware.recorder import RecordingStatus


def record(
    port: Annotated[str, typer.Option(help="Serial device, its by-id path, or a pyserial URL.")],
    store: Annotated[Path, typer.Option(help="SQLite file; made when it is not there, continued when it is.")],
    protocol: Annotated[str, typer.Option(help="What the instrument speaks: frames.")] = "frames",
    count: Annotated[
        int | None, typer.Option(min=1, help="Echoes to store before stopping [default: until Ctrl-C].")
    ] = None,
    baud: Annotated[int, typer.Option(min=1, help="Line rate [bit/s].")] = 115200,
    label: Annotated[list[str] | None, typer.Option(help="key=value kept with every echo; may be repeated.")] = None,
    commit_interval: Annotated[float, typer.Option(min=0.0, help="Seconds of echoes that a kill can lose.")] = 0.25,
) -> None:
    """Record echoes from hardware until --count or Ctrl-C; a port that goes away is waited for."""
    from aerokernels.hardware.interrupt import interrupt_flag
    from aerokernels.hardware.port import open_port
    from aerokernels.hardware.protocols import require_protocol
    from aerokernels.hardware.recorder import Recorder
    from aerokernels.hardware.store import EchoStore

    require_protocol(protocol)
    labels = parse_labels(label or [])
    reopen = partial(open_port, port, baud=baud)
    # The port comes first: where there is none, no store is left behind.
    with interrupt_flag() as interrupted, closing(reopen()) as first, EchoStore(store) as echoes, reporter() as report:
        try:
            echoes.begin_recording(port, protocol, labels)
            status = Recorder(
                first,
                echoes,
                reopen,
                count=count,
                commit_interval=commit_interval,
                stopped=interrupted.is_set,
                report=report,
            ).run()
        except sqlite3.OperationalError as error:
            raise RuntimeError(
                f"store {store}: {error}; what was committed is safe: "
                "make room or unlock the file, then record again into the same store"
            ) from error
    typer.echo(f"done: {describe(status)}, in {store}")


def parse_labels(pairs: list[str]) -> dict[str, str]:
    """Labels from "key=value" texts.

    Raises:
        ValueError: a text without a key or without "=", or a key given twice.
    """
    labels: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not key or not equals:
            raise ValueError(f"--label {pair!r}: give key=value, for example mach=3")
        if key in labels:
            raise ValueError(f"--label {pair!r}: {key!r} is given twice; give each key once")
        labels[key] = value
    return labels


def describe(status: "RecordingStatus") -> str:
    """One line about what is on the disk."""
    parts = [f"stored {status.stored_count}"]
    if status.last_sequence is not None:
        parts.append(f"last sequence {status.last_sequence}")
    if status.last_peak is not None:
        parts.append(f"last peak {status.last_peak:.3f} V")
    parts.append(f"damaged {status.damaged_count}")
    parts.append(f"missing {status.missing_count}")
    if status.duplicate_count:
        parts.append(f"sent twice {status.duplicate_count}")
    if status.reconnect_count:
        parts.append(f"reconnected {status.reconnect_count}")
    if not status.port_open:
        parts.append("port away, waiting for it")
    return ", ".join(parts)


@contextmanager
def reporter() -> Iterator[Callable[["RecordingStatus"], None]]:
    """Live on a terminal; elsewhere a line when something was committed, at most one a second."""
    from rich.console import Console

    console = Console()
    if console.is_terminal:
        with console.status("waiting for the first echo") as live:
            yield lambda status: live.update(describe(status))
        return
    told: list[float] = []

    def tell(status: "RecordingStatus") -> None:
        now = time.monotonic()
        if not told or now - told[-1] >= 1.0:
            told[:] = [now]
            print(describe(status), flush=True)

    yield tell
