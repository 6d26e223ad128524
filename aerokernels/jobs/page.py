"""Reports as self-contained HTML pages, by the template templates/report.html."""

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from aerokernels.display.plain_text import plain
from aerokernels.display.shown import NOTHING
from aerokernels.jobs.figure_layout import house_style, png
from aerokernels.process.foreign_files import fault_text
from aerokernels.process.opened import OPENED

if TYPE_CHECKING:
    import jinja2

Picture = tuple[str, str, Callable]  # name, caption, a function that draws it
Figure = tuple[str, str, bytes | str]  # name, caption, a PNG file or the reason why there is none


def page(
    title: str,
    lead: str,
    sections: Iterable[Mapping[str, Any]],
    *,
    cards: Iterable[tuple[str, str]] = (),
    remarks: Iterable[tuple[str, str]] = (),
    alarm: bool = False,
) -> str:
    """Return a complete HTML document; all texts are escaped.

    Args:
        title: Its heading.
        lead: The line below it.
        sections: Each a mapping with "title" and any of: "paragraphs", texts; "figures", see `drawn`; "rows", pairs of
            name and value; "table", columns and rows; "bullets", lines; "text", preformatted; "film", see the template.
        cards: The most important numbers, as pairs of words and value.
        remarks: What a reader must know besides the numbers, as pairs of heading and text.
        alarm: Whether the numbers are not meaningful.
    """
    return OPENED.once("template of reports", _template).render(
        title=title, lead=lead, sections=list(sections), cards=list(cards), remarks=list(remarks), alarm=alarm
    )


def drawn(pictures: Iterable[Picture]) -> list[Figure]:
    """Draw figures; one that cannot be drawn is replaced by the reason, since a report needs no figure."""
    figures: list[Figure] = []
    for name, caption, draw in pictures:
        try:
            with house_style():
                figures.append((name, caption, png(draw())))
        except Exception as fault:
            figures.append((name, caption, fault_text(fault, None)))
    return figures


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> dict[str, Any]:
    """Return a section with a table."""
    return {"title": title, "table": (columns, list(rows))}


def embedded(data: bytes) -> str:
    """Return a PNG file as a data URL."""
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"


def _template() -> "jinja2.Template":
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aerokernels.jobs"),
        autoescape=True,
        finalize=lambda value: plain(value) if type(value) is str else value,
    )
    environment.globals["nothing"] = NOTHING
    # The width is in the head of a PNG file; a wide picture has two panels and can be scrolled on a phone.
    environment.filters |= {"embedded": embedded, "is_wide": lambda data: int.from_bytes(data[16:20], "big") > 850}
    return environment.get_template("report.html")
