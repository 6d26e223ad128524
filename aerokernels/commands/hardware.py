"""Commands for recorded echoes: record, board, export, compare."""

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aerokernels.commands._output import Screen, note, output, print_table, result, say, shown_progress, silence, warn
from aerokernels.display.plain_text import plain

if TYPE_CHECKING:
    from aerokernels.hardware.recorder import RecordingStatus
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

    from aerokernels.hardware import DIALECT_NAMES, PROTOCOLS
    from aerokernels.hardware.port import PortError, open_port
    from aerokernels.hardware.recorder import NO_GOOD_FRAME, Recorder
    from aerokernels.hardware.sources import CurveStream, FrameStream
    from aerokernels.hardware.store import EchoStore
    from aerokernels.inputs.checks import check_choice
    from aerokernels.process.interrupt import interrupt_flag

    check_choice(protocol, "--protocol", PROTOCOLS)
    check_choice(dialect, "--dialect", ("auto", *DIALECT_NAMES))
    labels = parse_labels(label or [])
    with interrupt_flag() as interrupted:

        def connect() -> "EchoStream":
            """Open the port and find the instrument on it, for the first time or again."""
            opened = open_port(port, baud=baud, flow=flow)
            if protocol == "scpi":
                return CurveStream(opened, dialect=dialect, timeout=timeout, stopped=interrupted.is_set)
            return FrameStream(opened)

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


def parse_labels(pairs: list[str]) -> dict[str, str]:
    """Parse "key=value" texts into labels."""
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
    port = f"port {'' if status.port_open else 'away: '}{status.port_state}"
    parts = (
        (True, f"stored {status.stored_count}"),
        (status.last_sequence is not None, f"last sequence {status.last_sequence}"),
        (rate is not None, f"{rate or 0.0:.1f}/s"),
        (status.last_peak is not None, f"last peak {status.last_peak or 0.0:.3f} V"),
        (True, f"damaged {status.damaged_count}, missing {status.missing_count}"),
        (status.duplicate_count, f"sent twice {status.duplicate_count}"),
        (status.reconnect_count, f"reconnected {status.reconnect_count}"),
        (rate is not None, port),
    )
    return ", ".join(text for is_said, text in parts if is_said)


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
    console, begin = Console(file=screen), time.monotonic()

    def text(status: "RecordingStatus") -> str:
        return plain(describe(status, status.stored_count / max(time.monotonic() - begin, 1e-3)))

    if console.is_terminal:
        with console.status("waiting for the first echo") as live:
            yield lambda status: live.update(Text(text(status), no_wrap=True, overflow="ellipsis"))
        return
    shown_at = -1.0
    shown: tuple[RecordingStatus, tuple[bool, int]] | None = None

    def tell(status: "RecordingStatus") -> None:
        nonlocal shown_at, shown
        now, port = time.monotonic(), (status.port_open, status.reconnect_count)
        if (status, port) != shown and (now - shown_at >= 1.0 or (shown is not None and port != shown[1])):
            shown_at, shown = now, (status, port)
            try:
                print(text(status), flush=True)
            except OSError:  # the reader has left, or the log's disk is full: no reason to stop recording
                silence(sys.stdout)

    yield tell


def board(
    link: Annotated[Path, typer.Option(help="Path of the simulated port: a symbolic link, removed at the end.")],
    protocol: Annotated[str, typer.Option(help="frames (digitiser board) or scpi (oscilloscope).")] = "frames",
    dialect: Annotated[str, typer.Option(help="For --protocol scpi: tektronix or rigol.")] = "tektronix",
    echo: Annotated[
        Path | None,
        typer.Option(help="Folder or result.nc of a run whose echo through the flow is sent [default: --scene]."),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(help="TOML file or shipped scene whose echo in vacuum is sent [default: wind-tunnel-static]."),
    ] = None,
    rate: Annotated[float, typer.Option(help="Echoes per second.")] = 50.0,
    count: Annotated[int | None, typer.Option(min=1, help="Echoes to send [default: until Ctrl-C].")] = None,
    noise: Annotated[float, typer.Option(min=0.0, help="Standard deviation of the noise [V].")] = 0.02,
    samples: Annotated[int, typer.Option(min=1, max=65535, help="Samples per echo.")] = 128,
    sample_period: Annotated[int, typer.Option(min=1, max=2**32 - 1, help="Time between samples [ps].")] = 250,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
) -> None:
    """Simulate a digitiser board or an oscilloscope.

    With it, `record` can be tried without hardware.
    """
    from aerokernels.hardware import DIALECT_NAMES, PROTOCOLS
    from aerokernels.hardware.simulator import (
        DEFAULT_SCENE,
        EchoSource,
        PseudoTerminal,
        SimulatedScope,
        run_board,
        run_scope,
    )
    from aerokernels.inputs.checks import check_choice
    from aerokernels.process.interrupt import interrupt_flag

    check_choice(protocol, "--protocol", PROTOCOLS)
    check_choice(dialect, "--dialect", DIALECT_NAMES)
    if not rate > 0.0:
        raise ValueError(f"--rate {rate}: give a positive number of echoes per second")
    if echo is not None and scene is not None:
        raise ValueError(f"--echo {echo} and --scene {scene}: give the run or the scene, not both")
    make, place = (EchoSource.from_scene, scene or DEFAULT_SCENE) if echo is None else (EchoSource.from_result, echo)
    source = make(place, sample_count=samples, sample_period_ps=sample_period, noise=noise)
    with interrupt_flag() as interrupted, PseudoTerminal(link) as terminal:
        more = "" if protocol == "frames" else f"--protocol {protocol} "
        if not (output.quiet or output.as_json):
            say(f"board on {link} ({terminal.name}); record it with: aerokernels record {more}--port {link} ...")
        if protocol == "scpi":
            scope = SimulatedScope(source, dialect=dialect, rate=rate, seed=seed)
            sent, what = run_scope(terminal, scope, count=count, stopped=interrupted.is_set), "curves"
        else:
            sent = run_board(terminal, source, rate=rate, count=count, seed=seed, stopped=interrupted.is_set)
            what = "frames"
    result(f"done: {sent} {what} sent", {"sent_count": sent, "protocol": protocol})


def export(
    store: Annotated[Path, typer.Argument(help="SQLite file that `record` wrote or is writing.")],
    out: Annotated[Path, typer.Option(help="FILE.nc or FILE.csv; an existing file is replaced.")],
    label: Annotated[
        list[str] | None, typer.Option(help="key=value: export only echoes with this label. Repeatable.")
    ] = None,
) -> None:
    """Write the echoes of a store to a NetCDF or CSV file.

    A recording into the store may go on meanwhile.
    """
    from aerokernels.hardware.export import export as write_echoes
    from aerokernels.hardware.store import EchoStore

    labels = parse_labels(label or [])
    with EchoStore(store, read_only=True) as echoes:
        count = write_echoes(echoes, out, labels)
    note(f"wrote {count} echoes to {out}")


def compare(
    store: Annotated[
        Path,
        typer.Argument(metavar="STORE", help="The recorder's store, or a CSV or NetCDF file of recorded waveforms."),
    ],
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...",
            help="Folders of finished runs. A label mach=3 uses the run at Mach 3, or DIR if given as mach=3=DIR.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for report.html, compare.csv, compare.png, compare.nc and summary.json.")
    ] = None,
    align: Annotated[
        str,
        typer.Option(
            help="Trigger offset: none (times as recorded), each (measured on each label), or a label such as mach=0 "
            "(measured on that label, applied to all)."
        ),
    ] = "none",
    trigger_offset: Annotated[
        str, typer.Option(help="Known trigger offset: time by which the recorded times are late, such as 2.5 ns.")
    ] = "0 s",
    voltage_offset: Annotated[
        str, typer.Option(help="Known offset of the recorded voltages, which is subtracted, such as 12 mV.")
    ] = "0 V",
    threshold: Annotated[str | None, typer.Option(help="Level of the leading edge [default: the run's].")] = None,
    ranged: Annotated[int, typer.Option(help="Greatest number of echoes per label that are ranged one by one.")] = 300,
) -> None:
    """Compare recorded echoes with simulated ones.

    Label by label: peaks, relative errors, correlation, ranges.
    """
    from aerokernels.inputs.units import quantity
    from aerokernels.jobs.comparison import CompareOptions, compare_recording
    from aerokernels.jobs.comparison_report import TABLES, write_comparison
    from aerokernels.jobs.recorded import label_text
    from aerokernels.jobs.run_folder import read_run
    from aerokernels.jobs.store import check_output_folder

    options = CompareOptions(
        align=align,
        trigger_offset=quantity(trigger_offset, "time"),
        voltage_offset=quantity(voltage_offset, "voltage"),
        threshold=None if threshold is None else quantity(threshold, "voltage"),
        ranged_count=ranged,
    )
    folders = [read_run(text) for text in runs]
    if out is not None:
        check_output_folder(out)
    with shown_progress("compare") as progress:
        result = compare_recording(store, folders, options, progress)
        files = [] if out is None else write_comparison(result, out)
    for make in TABLES:
        title, columns, rows = make(result)
        print_table(title, columns, rows)
    for text in result.warnings:
        warn(f"warning: {text}")
    unfit = sum(one.unfit_count for one in result.labels)
    if unfit:
        note(f"skipped {unfit} echoes with too few samples or without a sample period")
    if result.left_out:
        (note if output.as_json else say)(f"labels without a run: {', '.join(map(label_text, result.left_out))}")
    if files:
        note(f"wrote {', '.join(files)} to {out}")


COMMANDS = {"record": record, "board": board, "export": export, "compare": compare}
