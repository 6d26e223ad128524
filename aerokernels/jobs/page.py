"""HTML pages that stand alone: pictures are inside them, and they load nothing."""

import base64
import html
from collections.abc import Callable, Iterable, Sequence

from aerokernels.jobs.plots import png
from aerokernels.jobs.report import CSS

Picture = tuple[str, str, Callable]  # name, caption, a function that draws it


def page(title: str, lead: str, parts: Iterable[str]) -> str:
    """A complete HTML document."""
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{html.escape(title)} · aerokernels</title><style>{CSS}</style></head>\n<body>"
        f"<h1>{html.escape(title)}</h1><p class='lead'>{html.escape(lead)}</p>" + "\n".join(parts) + "</body></html>\n"
    )


def embedded(data: bytes) -> str:
    """A PNG file as the address of a picture."""
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"


def pictures(shown: Iterable[Picture]) -> str:
    """Pictures with their captions; one that cannot be drawn says why, since the numbers stand without it."""
    found = []
    for name, caption, draw in shown:
        try:
            address = embedded(png(draw()))
        except Exception as fault:
            why = f"{type(fault).__name__}: {' '.join(str(fault).split())}"
            found.append(f"<p>No picture of this: {html.escape(caption)} ({html.escape(why)})</p>")
            continue
        found.append(
            f'<figure id="{html.escape(name)}"><img alt="{html.escape(caption)}" src="{address}">'
            f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        )
    return "".join(found)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with a head."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def cards(rows: Iterable[tuple[str, str]]) -> str:
    """Numbers that a reader asks for first."""
    found = "".join(
        f'<div class="card"><b>{html.escape(value)}</b><span>{html.escape(words)}</span></div>' for words, value in rows
    )
    return f"<div class='cards'>{found}</div>"


def section(title: str, content: str) -> str:
    """A heading and what stands below it, which is HTML."""
    return f"<h2>{html.escape(title)}</h2>{content}"


def text_block(text: str) -> str:
    """A text as it is written."""
    return f"<pre>{html.escape(text)}</pre>"
