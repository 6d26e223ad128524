"""Build the documents: run docstring examples, check pages against the program, execute tutorials, follow links.

Exit status 0 if there is no fault, warning or dead link; else 1, with the faults.
"""

import argparse
import datetime
import doctest
import os
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "_ext")]

# Modules whose import needs a package of an extra, or that run when they are imported.
APART = ("aerokernels.__main__", "aerokernels.benchmark.peers")


def main() -> None:
    """Build the documents, or do what the options request."""
    parser = argparse.ArgumentParser(prog="scripts/docs", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "docs", help="folder of the site")
    parser.add_argument("--no-execute", action="store_true", help="run no tutorial: a quick look at the pages")
    parser.add_argument(
        "--remake", metavar="NAME", help="make a table of the validation pages again, and note the date"
    )
    options = parser.parse_args()
    if options.remake:
        remake(options.remake)
        return
    # The tutorials' commands must run in this environment and this checkout.
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}".rstrip(os.pathsep)
    faults = docstring_examples()
    faults += run(
        "the pages against the program", ["-m", "pytest", "-q", *map(str, (ROOT / "tests").glob("test_document*.py"))]
    )
    os.environ["AEROKERNELS_DOCS_EXECUTE"] = "off" if options.no_execute else "on"
    build = ["-m", "sphinx", "-b", "html", "-W", "--keep-going", "-q", str(ROOT / "docs"), str(options.out)]
    faults += run("the build", build)
    faults += [f"dead link: {link}" for link in dead_links(options.out)]
    for fault in faults:
        print(fault, file=sys.stderr)
    if faults:
        raise SystemExit(1)
    print(f"wrote {options.out / 'index.html'}")


def run(what: str, arguments: list[str]) -> list[str]:
    """Run Python with these arguments; return the fault, if it fails."""
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT)
    return [f"{what} failed"] if done.returncode else []


def docstring_examples() -> list[str]:
    """Run every `>>>` of the package; return the faults."""
    import aerokernels

    faults, tried = [], 0
    for found in walk_packages(aerokernels.__path__, "aerokernels."):
        if found.name in APART or ".kernels" in found.name:
            continue
        source = Path(ROOT, *found.name.split(".")).with_suffix(".py")
        source = source if source.exists() else source.with_suffix("") / "__init__.py"
        if ">>>" not in source.read_text(encoding="utf-8"):
            continue
        module = import_module(found.name)
        failed, examples = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
        tried += examples
        faults += [f"{found.name}: {failed} of {examples} docstring examples fail"] if failed else []
    print(f"{tried} docstring examples run")
    return faults


class _Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list) -> None:
        """Store links and anchors."""
        given = dict(attrs)
        self.anchors |= {given[name] for name in ("id", "name") if given.get(name)}
        self.links += [given[name] for name in ("href", "src") if given.get(name)]


def dead_links(site: Path) -> list[str]:
    """Return the local links of a site that lead to no file or to no anchor."""
    pages = {}
    for path in site.rglob("*.html"):
        pages[path.resolve()] = _Page()
        pages[path.resolve()].feed(path.read_text(encoding="utf-8"))
    dead = set()
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or link in ("#", "") or "_static" in parts.path:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            lost = not target.exists()
            lost |= bool(parts.fragment) and target in pages and unquote(parts.fragment) not in pages[target].anchors
            if lost:
                dead.add(f"{path.relative_to(site.resolve())}: {link}")
    return sorted(dead)


def remake(name: str) -> None:
    """Run the command of a record in docs/validation/made.toml, and write its date."""
    from validation_pages import RECORDS, records

    found = records()
    if name not in found:
        raise SystemExit(f"error: {name!r} is not made by any command: choose one of {', '.join(found)}")
    subprocess.run(shlex.split(found[name]["command"]), cwd=ROOT, check=True)
    today = datetime.date.today().isoformat()
    RECORDS.write_text(noted(RECORDS.read_text(encoding="utf-8"), name, today), encoding="utf-8")


def noted(text: str, name: str, date: str) -> str:
    """Return the records with another date for one of them."""
    start = text.index(f"[{name}]")
    end = text.find("\n[", start)
    record = text[start : end if end >= 0 else None]
    new = re.sub(r'^date = ".*"$', f'date = "{date}"', record, flags=re.MULTILINE)
    return text[:start] + new + (text[end:] if end >= 0 else "")


if __name__ == "__main__":
    main()
