"""`aerokernels board`: a simulated digitiser board on a pseudo-terminal."""

from pathlib import Path
from typing import Annotated

import typer


def board(
    link: Annotated[Path, typer.Option(help="Where to put the port: a symbolic link, removed at the end.")],
    protocol: Annotated[str, typer.Option(help="What the board speaks: frames.")] = "frames",
    echo: Annotated[
        Path | None, typer.Option(help="result.nc of a run whose echo is sent [default: a Gaussian echo].")
    ] = None,
    rate: Annotated[float, typer.Option(help="Echoes per second.")] = 50.0,
    count: Annotated[int | None, typer.Option(min=1, help="Frames before it ends [default: until Ctrl-C].")] = None,
    noise: Annotated[float, typer.Option(min=0.0, help="Standard deviation of the noise [V].")] = 0.02,
    samples: Annotated[int, typer.Option(min=1, max=65535, help="Samples of a frame.")] = 128,
    sample_period: Annotated[int, typer.Option(min=1, max=2**32 - 1, help="Time between samples [ps].")] = 250,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.")] = 0,
) -> None:
    """Simulate a digitiser board: try `record` without hardware. Sends while someone has the port open."""
    from aerokernels.hardware.board import EchoSource, run_board
    from aerokernels.hardware.interrupt import interrupt_flag
    from aerokernels.hardware.protocols import PROTOCOLS, require_one_of
    from aerokernels.hardware.pseudo_terminal import PseudoTerminal

    require_one_of("--protocol", protocol, PROTOCOLS)
    if not rate > 0.0:
        raise ValueError(f"--rate {rate}: give a positive number of echoes per second")
    if echo is None:
        source = EchoSource.gaussian(sample_count=samples, sample_period_ps=sample_period, noise=noise)
    else:
        source = EchoSource.from_result(echo, sample_count=samples, sample_period_ps=sample_period, noise=noise)
    with interrupt_flag() as interrupted, PseudoTerminal(link) as terminal:
        print(f"board on {link} ({terminal.name}); record it with: aerokernels record --port {link} ...", flush=True)
        sent = run_board(terminal, source, rate=rate, count=count, seed=seed, stopped=interrupted.is_set)
    print(f"done: {sent} frames sent", flush=True)
