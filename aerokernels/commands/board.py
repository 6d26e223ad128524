"""`aerokernels board`: a simulated digitiser board or oscilloscope on a pseudo-terminal."""

from pathlib import Path
from typing import Annotated

import typer


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
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="KIND=PROBABILITY per echo: torn, flipped, glued, garbage, gap, repeat, stall or unplug. Repeatable."
        ),
    ] = None,
    pause: Annotated[float, typer.Option(min=0.0, help="Duration of a stall or of an unplugged port [s].")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise and the faults.")] = 0,
) -> None:
    """Simulate a digitiser board or an oscilloscope.

    With it, `record` can be tried without hardware.
    """
    from aerokernels.commands._output import output, result, say
    from aerokernels.hardware import DIALECT_NAMES, PROTOCOLS
    from aerokernels.hardware.echo_source import DEFAULT_SCENE, EchoSource
    from aerokernels.hardware.simulator import FaultPlan, PseudoTerminal, SimulatedScope, run_board, run_scope
    from aerokernels.inputs.checks import check_choice
    from aerokernels.process.interrupt import interrupt_flag

    check_choice(protocol, "--protocol", PROTOCOLS)
    check_choice(dialect, "--dialect", DIALECT_NAMES)
    if not rate > 0.0:
        raise ValueError(f"--rate {rate}: give a positive number of echoes per second")
    faults = FaultPlan.parse(fault or [], pause, seed)
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
            sent, what = run_scope(terminal, scope, count=count, faults=faults, stopped=interrupted.is_set), "curves"
        else:
            sent = run_board(
                terminal, source, rate=rate, count=count, seed=seed, faults=faults, stopped=interrupted.is_set
            )
            what = "frames"
    text = f"done: {sent} {what} sent{', faults: ' if str(faults) else ''}{faults}"
    result(text, {"sent_count": sent, "protocol": protocol, "faults": str(faults)})
