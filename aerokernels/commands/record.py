"""`aerokernels record`: log echoes from a serial port into a store."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from aerokernels.hardware.sources import EchoStream


def record(
    port: Annotated[
        str, typer.Option(help="Serial device, its by-id path, or a pyserial URL (socket://, rfc2217://, ...).")
    ],
    store: Annotated[Path, typer.Option(help="SQLite file; created if it does not exist, else continued.")],
    protocol: Annotated[str, typer.Option(help="frames (digitiser board) or scpi (oscilloscope).")] = "frames",
    count: Annotated[
        int | None, typer.Option(min=1, help="Echoes to store before stopping [default: until Ctrl-C].")
    ] = None,
    baud: Annotated[int, typer.Option(min=1, help="Line rate [bit/s].")] = 115200,
    flow: Annotated[str, typer.Option(help="Hardware flow control: none, rtscts or dsrdtr.")] = "none",
    label: Annotated[list[str] | None, typer.Option(help="key=value stored with every echo. Repeatable.")] = None,
    dialect: Annotated[
        str, typer.Option(help="For --protocol scpi: auto (ask the instrument), tektronix or rigol.")
    ] = "auto",
    timeout: Annotated[
        float, typer.Option(min=0.1, help="Longest silence before and within an oscilloscope's answer [s].")
    ] = 3.0,
    stall: Annotated[
        float, typer.Option(min=0.0, help="Silence after which the port is closed and opened again [s]; 0: never.")
    ] = 30.0,
    commit_interval: Annotated[
        float,
        typer.Option(
            min=0.0, help="Longest time between two commits [s]; a kill loses at most the echoes of this time."
        ),
    ] = 0.25,
) -> None:
    """Record echoes from hardware.

    Record until --count or Ctrl-C; a port that is lost is opened again when it comes back.
    """
    from dataclasses import asdict

    from aerokernels.commands._output import note, output, result, say
    from aerokernels.commands._recording import describe, parse_labels, reporter
    from aerokernels.display.plain_text import plain
    from aerokernels.hardware import DIALECT_NAMES, PROTOCOLS
    from aerokernels.hardware.port import PortError
    from aerokernels.hardware.recorder import NO_GOOD_FRAME, Recorder
    from aerokernels.hardware.store import EchoStore
    from aerokernels.inputs.checks import check_choice
    from aerokernels.process.interrupt import interrupt_flag

    check_choice(protocol, "--protocol", PROTOCOLS)
    check_choice(dialect, "--dialect", ("auto", *DIALECT_NAMES))
    labels = parse_labels(label or [])
    with interrupt_flag() as interrupted:
        connect = connector(port, protocol, baud, flow, dialect, timeout, interrupted.is_set)
        # Open the port first, so that a missing port leaves no empty store behind.
        try:
            stream = connect()
        except PortError:
            if interrupted.is_set():  # interrupted during the search for an instrument
                raise KeyboardInterrupt from None
            raise
        try:
            with EchoStore(store) as echoes, reporter() as report:
                echoes.begin_recording(port, protocol, labels)
                if not (output.quiet or output.as_json):
                    say(plain(f"recording {protocol} from {port} into {store}"))
                status = Recorder(
                    stream,
                    echoes,
                    connect,
                    count=count,
                    commit_interval=commit_interval,
                    stall_time=stall,
                    stopped=interrupted.is_set,
                    report=report,
                ).run()
        finally:
            stream.close()
    if status.port_state == NO_GOOD_FRAME or (
        status.damaged_count and not status.stored_count + status.duplicate_count
    ):
        note(
            f"bytes came from {port}, but no good frame: check that the instrument sends at --baud {baud} and in "
            f"--protocol {protocol}"
        )
    result(f"done: {describe(status)}, in {store}", {**asdict(status), "store": str(store)})


def connector(
    port: str, protocol: str, baud: int, flow: str, dialect: str, timeout: float, stopped: Callable[[], bool]
) -> "Callable[[], EchoStream]":
    """Return a function that opens the port and finds the instrument on it, for the first time or again."""
    from aerokernels.hardware.port import open_port
    from aerokernels.hardware.sources import CurveStream, FrameStream

    def connect() -> "EchoStream":
        opened = open_port(port, baud=baud, flow=flow)
        if protocol == "scpi":
            return CurveStream(opened, dialect=dialect, timeout=timeout, stopped=stopped)
        return FrameStream(opened)

    return connect
