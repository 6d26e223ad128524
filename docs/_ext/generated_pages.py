"""Sphinx: pages that are made from the program itself, before anything is read: API, command line, scene keys, validation."""

import sys
from pathlib import Path
from typing import Any

import api_pages
import command_pages
import scene_pages
import validation_pages

PAGES = {
    "reference/command-line.md": command_pages.page,
    "reference/scene.md": scene_pages.page,
    "validation/made.md": validation_pages.page,
}


def write_pages(docs: Path) -> list[Path]:
    """Write every generated page under `docs`; what has not changed is left alone, so that Sphinx need not read it again."""
    texts = {name: make() for name, make in PAGES.items()}
    texts |= {f"reference/api/{name}": text for name, text in api_pages.pages().items()}
    for name, text in texts.items():
        path = docs / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in (docs / "reference" / "api").glob("*.md"):
        if f"reference/api/{path.name}" not in texts:
            path.unlink()
    return [docs / name for name in texts]


def setup(app: Any) -> dict[str, bool]:
    """Write the pages when the builder starts."""
    write_pages(Path(app.srcdir))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    for page in write_pages(Path(__file__).resolve().parent.parent):
        print(page)
    sys.exit(0)
