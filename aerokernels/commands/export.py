"""`aerokernels export`: write the echoes of a store as NetCDF or CSV."""

from pathlib import Path
from typing import Annotated

import typer


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
    from aerokernels.commands._output import note
    from aerokernels.commands._recording import parse_labels
    from aerokernels.hardware.export import export as write_echoes
    from aerokernels.hardware.store import EchoStore

    labels = parse_labels(label or [])
    with EchoStore(store, read_only=True) as echoes:
        count = write_echoes(echoes, out, labels)
    note(f"wrote {count} echoes to {out}")
