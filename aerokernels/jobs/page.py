"""Build self-contained HTML pages with embedded pictures; all texts are escaped here."""

import base64
import html
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from aerokernels.display.flatness import NOTHING
from aerokernels.display.plain_text import plain
from aerokernels.jobs.figure_layout import png_or_fault

Picture = tuple[str, str, Callable]  # name, caption, a function that draws it
WIDE = 850  # [pixels] width above which a picture has two panels
SHORT = 24  # [characters] up to which a cell is on one line
CSS = """
body { font: 15px/1.55 system-ui, "Segoe UI", Roboto, sans-serif; color: #1d2630; background: white;
  margin: 0 auto; max-width: 1080px; padding: 28px 20px 60px; }
h1 { font-size: 1.6em; margin: 0 0 .1em; }
h2 { font-size: 1.15em; margin: 2.2em 0 .6em; border-bottom: 1px solid #e3e7eb; padding-bottom: .25em; }
.lead { color: #5b6470; margin: 0 0 1.4em; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(240px, 1fr)); gap: 10px; }
.card { background: #f3f6f8; border-radius: 8px; padding: 10px 14px; }
.card b { display: block; font-size: 1.22em; font-weight: 600; }
.card span { color: #5b6470; font-size: .87em; }
.alarm, .note { border-radius: 8px; padding: 10px 14px; margin: 0 0 12px; }
.alarm { background: #fde8e4; border-left: 5px solid #b42318; }
.note { background: #fff4dc; border-left: 5px solid #b7791f; }
.alarm p, .note p { margin: .15em 0; }
figure { margin: 1.4em 0; overflow-x: auto; }
figure img { max-width: 100%; height: auto; }
figcaption { color: #5b6470; font-size: .92em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: 3px 18px 3px 0; border-bottom: 1px solid #eef1f3; vertical-align: top; text-align: left; }
th { font-weight: 500; color: #45505c; white-space: nowrap; }
td { overflow-wrap: anywhere; }
td.short { white-space: nowrap; }
pre { background: #f3f6f8; border-radius: 8px; padding: 12px 14px; overflow-x: auto; font-size: .87em; }
@media (max-width: 700px) {
  body { padding: 16px 12px 40px; }
  .cards { grid-template-columns: 1fr 1fr; }
  .card { padding: 8px 10px; }
  figure img.wide { max-width: none; width: 760px; }
  th { white-space: normal; min-width: 8em; }
  td, th { padding-right: 10px; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 11px; }
  .card, .alarm, .note { border: 1px solid #8a94a0; }
  figure, .card, tr { break-inside: avoid; }
  h2 { break-after: avoid; }
  pre { white-space: pre-wrap; }
}
"""


def _escaped(text: str) -> str:
    return html.escape(plain(text))


def page(title: str, lead: str, parts: Iterable[str]) -> str:
    """Return a complete HTML document; the parts are HTML."""
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{_escaped(title)} · aerokernels</title><style>{CSS}</style></head>\n<body>"
        f"<h1>{_escaped(title)}</h1><p class='lead'>{_escaped(lead)}</p>" + "\n".join(parts) + "</body></html>\n"
    )


def embedded(data: bytes) -> str:
    """Return a PNG file as a data URL."""
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"


def picture(name: str, caption: str, data: bytes) -> str:
    """Return an HTML figure of a PNG file with its caption; a wide one can be scrolled on a phone."""
    wide = ' class="wide"' if int.from_bytes(data[16:20], "big") > WIDE else ""  # the width in a PNG file's head
    caption = _escaped(caption)
    image = f'<img alt="{caption}" src="{embedded(data)}"{wide}>'
    return f'<figure id="{_escaped(name)}">{image}<figcaption>{caption}</figcaption></figure>'


def pictures(shown: Iterable[Picture]) -> str:
    """Return HTML figures with their captions; a figure that cannot be drawn is replaced by the reason."""
    made = ((name, caption, png_or_fault(draw)) for name, caption, draw in shown)
    return "".join(
        paragraph(f"No picture: {caption} ({data})") if isinstance(data, str) else picture(name, caption, data)
        for name, caption, data in made
    )


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table with column headings."""
    head = "".join(f"<th>{_escaped(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _cell(text: str) -> str:
    """Return a cell of a table; a number and its error stay on one line."""
    short = ' class="short"' if len(text) <= SHORT else ""
    return f"<td{short}>{_escaped(text)}</td>"


def named_values(rows: Iterable[tuple[str, str]]) -> str:
    """Return an HTML table of names and values; "none" if there are no rows."""
    body = "".join(f"<tr><th>{_escaped(name)}</th><td>{_escaped(value)}</td></tr>" for name, value in rows)
    return f"<table>{body}</table>" if body else "<p>none</p>"


def cards(rows: Iterable[tuple[str, str]]) -> str:
    """Return the most important numbers as a grid of cards, and in a sentence those that are below rounding."""
    rows = list(rows)
    found = "".join(
        f'<div class="card"><b>{_escaped(value)}</b><span>{_escaped(words)}</span></div>'
        for words, value in rows
        if value != NOTHING
    )
    left = [words for words, value in rows if value == NOTHING]
    return f"<div class='cards'>{found}</div>" + (paragraph(f"Below rounding: {'; '.join(left)}.") if left else "")


def remarks(rows: Iterable[tuple[str, Any]], kind: str = "note") -> str:
    """Return a box of remarks that a reader must know besides the numbers; an empty text without remarks.

    Args:
        rows: Heading and text of each remark.
        kind: "note", or "alarm" if the numbers are not meaningful.
    """
    lines = "".join(f"<p><b>{_escaped(words)}:</b> {_escaped(str(text))}</p>" for words, text in rows)
    return f"<div class='{kind}'>{lines}</div>" if lines else ""


def section(title: str, content: str) -> str:
    """Return a heading followed by `content`, which is HTML."""
    return f"<h2>{_escaped(title)}</h2>{content}"


def paragraph(text: str) -> str:
    """Return a paragraph."""
    return f"<p>{_escaped(text)}</p>"


def bullets(lines: Iterable[str]) -> str:
    """Return a bullet list."""
    return "<ul>" + "".join(f"<li>{_escaped(line)}</li>" for line in lines) + "</ul>"


def text_block(text: str) -> str:
    """Return a preformatted text."""
    return f"<pre>{_escaped(text)}</pre>"
