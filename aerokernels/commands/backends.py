"""`aerokernels backends`: what this machine can compute on."""

import typer


def backends() -> None:
    """Show the backends and devices of this machine, work-arounds in force, and which one `auto` takes and why."""
    from aerokernels.commands._table import print_table
    from aerokernels.tracing import available_backends
    from aerokernels.tracing.engines.choice import choose_backend

    found = available_backends()
    print_table(
        "Backends and devices",
        ("backend", "device", "version", "float64", "memory", "what it is"),
        [
            (
                info.backend,
                info.device,
                info.version,
                "-" if info.device == "-" else "yes" if info.float64 else "no",
                f"{info.memory / 2**30:.1f} GiB" if info.memory else "-",
                info.description if info.available else f"absent: {info.reason}",
            )
            for info in found
        ],
    )
    for info in found:
        if info.workaround:
            typer.echo(f"work-around on {info.device}: {info.workaround}")
    backend, device, reason = choose_backend("auto", None)
    typer.echo(f"auto takes {backend} on {device}: {reason.removeprefix(f'backend {backend} on {device}: ')}")
