"""Write measured numbers to the docs: tables as Markdown and CSV, pages that contain them, the style of figures."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerokernels.display.canvas import WIDE, styled_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GRID_STYLE = {**WIDE, "axes.grid": True, "axes.axisbelow": True, "text.parse_math": True}


@contextmanager
def saved_figure(path: Path, width: float, height: float, dpi: int = 130) -> "Iterator[Figure]":
    """A figure of a size in inches in the docs' style; it is saved when the block ends."""
    with styled_figure(width, height, dpi, GRID_STYLE) as figure:
        yield figure
        figure.savefig(path)


def markdown_table(heading: Sequence[str], rows: Iterable[Sequence[str]], text_columns: int = 1) -> str:
    """A Markdown table, padded so that it reads as plain text as well; the first `text_columns` are flush left."""
    cells = [[*heading], *([*row] for row in rows)]
    width = [max(map(len, column)) for column in zip(*cells, strict=True)]

    def line(row: list[str]) -> str:
        padded = [
            cell.ljust(w) if i < text_columns else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(row, width, strict=True))
        ]
        return "| " + " | ".join(padded) + " |"

    rule = "|".join("-" * (w + 2) if i < text_columns else "-" * (w + 1) + ":" for i, w in enumerate(width))
    return "\n".join([line(cells[0]), f"|{rule}|", *map(line, cells[1:])]) + "\n"


def write_csv(path: Path, heading: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows as CSV; the heading names the unit of each column."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heading)
        writer.writerows(rows)


def marks(name: str) -> tuple[str, str]:
    """The lines that enclose a table on a page."""
    return f"<!-- {name}:begin -->", f"<!-- {name}:end -->"


def filled(page: Path, tables: Mapping[str, str]) -> str:
    """The text of a page with each table between its marks.

    Raises:
        ValueError: A page that is not there, or without the marks of one of the tables.
    """
    text = page.read_text(encoding="utf-8") if page.is_file() else ""
    for name, table in tables.items():
        begin, end = marks(name)
        head, found, rest = text.partition(begin)
        _, closed, tail = rest.partition(end)
        if not (found and closed):
            raise ValueError(f"{page}: no lines {begin} and {end} to put a table between: add them")
        text = f"{head}{begin}\n{table}{end}{tail}"
    return text
