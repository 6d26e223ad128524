"""Numbers in tables stay on one line: a browser breaks 1.1e-9 after its hyphen."""

import re

from docutils import nodes

NUMBERS = re.compile(r"[-+−±<>=~≤≥.,:;/()%\dxe ]*\d[-+−±<>=~≤≥.,:;/()%\dxe ]*")
LONGEST = 24  # signs: a longer row of numbers may break


def mark_numbers(app, document: nodes.document) -> None:
    """Give cells that hold nothing but short numbers the class "number" (see site.css)."""
    for cell in document.findall(nodes.entry):
        text = cell.astext().strip()
        if len(text) <= LONGEST and NUMBERS.fullmatch(text):
            cell["classes"].append("number")


def setup(app) -> dict[str, bool]:
    """Register it with Sphinx."""
    app.connect("doctree-read", mark_numbers)
    return {"parallel_read_safe": True}
