"""Sphinx: the picture of the cell tagged "cover" is also shown under a page's first paragraph."""

from typing import Any

from docutils import nodes

BUNDLE = "mime_bundle"  # what MyST-NB calls one output of a cell


def show_cover(app: Any, document: nodes.document) -> None:
    """Copy the first picture of the tagged cell to below the first paragraph, with the title as its text."""
    outputs = [
        output
        for cell in document.findall(nodes.container)
        if "tag_cover" in cell["classes"]
        for output in cell.findall(nodes.container)
        if output.get("nb_element") == BUNDLE and any(output.findall(nodes.image))
    ]
    first = next(iter(document.findall(nodes.paragraph)), None)
    if not outputs or first is None or first.parent is None:
        return
    cover = outputs[0].deepcopy()
    title = next(iter(document.findall(nodes.title))).astext()
    for picture in cover.findall(nodes.image):
        picture["alt"] = title
    first.parent.insert(first.parent.index(first) + 1, nodes.container("", cover, classes=["cover"]))


def setup(app: Any) -> dict[str, bool]:
    """After Sphinx has collected the pictures of the page."""
    app.connect("doctree-read", show_cover, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
