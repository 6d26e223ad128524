"""`aerokernels backends`: what this machine can compute on."""

import typer


def backends() -> None:
    """Show the backends and devices of this machine, and which one `auto` takes and why."""
    from aerokernels.commands._table import print_table
    from aerokernels.tracing import available_backends

    found = available_backends()
    print_table(
        "Backends and devices",
        ("backend", "device", "version", "float64", "memory", "what it is"),
        [
            (
                info.backend,
                info.device,
                info.version,
                "yes" if info.float64 else "no" if info.available else "-",
                f"{info.memory / 2**30:.1f} GiB" if info.memory else "-",
                info.description if info.available else f"absent: {info.reason}",
            )
            for info in found
        ],
    )
    taken = next(info for info in found if info.available)
    typer.echo(f"auto takes {taken.backend} on {taken.device}: {taken.reason}")
