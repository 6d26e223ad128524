"""Print tables: drawn on a terminal, as tab-separated lines for `grep` and `cut` elsewhere, or as JSON."""

import io
import re
from collections.abc import Sequence
from typing import Any

from aerokernels.commands._output import json_text, output, say
from aerokernels.display.plain_text import plain


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], data: Any = None) -> None:
    """Print rows of texts: a drawn table on a terminal, lines with tabs between the columns otherwise.

    With --json, print `data` instead; without `data`, print the table as a title and a list of objects.
    """
    if output.as_json:
        listed = {"title": title, "rows": [dict(zip(columns, row, strict=True)) for row in rows]}
        say(json_text(listed if data is None else data))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    if not console.is_terminal:
        for row in (columns, *rows):
            say("\t".join(re.sub(r"[\t\n]+", " ", plain(cell)) for cell in row))
        return
    from rich import box

    table = Table(box=box.SIMPLE_HEAD, title=Text(plain(title)), title_justify="left")
    for column in columns:
        table.add_column(Text(column), overflow="fold")
    for row in rows:
        table.add_row(*(Text(plain(cell)) for cell in row))
    drawn = io.StringIO()
    Console(file=drawn, force_terminal=True, width=console.width, color_system=console.color_system).print(table)  # type: ignore[arg-type]
    say(drawn.getvalue().rstrip("\n"))
