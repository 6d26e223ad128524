"""The documents against the program, without Sphinx: pages, links, code, commands, scene keys.

test_document_makers.py holds what is made from the program. `scripts/docs` does the rest: it executes every tutorial,
builds the site without warnings and follows every link of it.
"""

import ast
import importlib
import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
# Written when the documents are built.
MADE = ("docs/reference/api/", "docs/gallery/")
MADE_PAGES = {
    "docs/reference/python.md",
    "docs/reference/command-line.md",
    "docs/reference/scene.md",
    "docs/validation/made.md",
}
PAGES = sorted(
    path
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")]
    if path.name not in ("table.md", "tables.md")
    and path.parent != DOCS / "questions"  # answers, which questions.md holds, too
    and not (name := path.relative_to(ROOT).as_posix()).startswith(MADE)
    and name not in MADE_PAGES
)
FENCE = re.compile(r"^(?P<ticks>```+)(?P<kind>[^\n]*)\n(?P<body>.*?)^(?P=ticks)\s*$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")


@pytest.fixture(scope="module", autouse=True)
def generators():
    """The modules that make pages from the program."""
    sys.path.insert(0, str(DOCS / "_ext"))
    yield
    sys.path.remove(str(DOCS / "_ext"))


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path) -> list[tuple[str, str]]:
    """Kind and text of every fenced block, and of every indented one under the kind "indented"."""
    text = path.read_text(encoding="utf-8")
    found = [(match["kind"].strip(), match["body"]) for match in FENCE.finditer(text)]
    prose = FENCE.sub("", text)
    indented = re.findall(r"(?:^\n|\A)((?: {4}(?![-*] |\d+\. )[^\n]*\n)+)", prose, flags=re.MULTILINE)
    return found + [("indented", re.sub("^ {4}", "", body, flags=re.MULTILINE)) for body in indented]


def prose_of(path: Path) -> str:
    return FENCE.sub("", path.read_text(encoding="utf-8"))


def anchors_of(text: str) -> set[str]:
    """Anchors of the headings, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", heading.replace("`", "").lower()) for heading in headings]
    return {heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("path", PAGES, ids=named)
def test_relative_links_lead_somewhere(path: Path):
    for link in LINK.findall(prose_of(path)):
        target, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        place = (path.parent / target).resolve() if target else path
        name = place.relative_to(ROOT).as_posix() if place.is_relative_to(ROOT) else ""
        if name in MADE_PAGES or (name + "/").startswith(MADE) or name.startswith(MADE):
            continue
        assert place.exists(), f"{link}: nothing lies there"
        if anchor and place.suffix == ".md":
            assert anchor in anchors_of(place.read_text(encoding="utf-8")), f"{link}: no such heading"


def toctree(path: Path) -> list[Path]:
    """The pages that a page's toctrees name."""
    found = []
    for kind, body in blocks(path):
        if kind == "{toctree}":
            entries = [line.strip() for line in body.splitlines() if line.strip() and not line.startswith(":")]
            for entry in entries:
                found += (
                    sorted(path.parent.glob(f"{entry}.md"))
                    if "*" in entry
                    else [(path.parent / f"{entry}.md").resolve()]
                )
    return [page for page in found if page != path]


def test_every_page_is_reached_from_the_index():
    reached, waiting = set(), [DOCS / "index.md"]
    while waiting:
        page = waiting.pop()
        if page in reached:
            continue
        reached.add(page)
        name = named(page)
        if name in MADE_PAGES or name.startswith(MADE):
            continue
        assert page.exists(), f"{name} is in a toctree and is not there"
        waiting += toctree(page)
    left_out = {path for path in PAGES if path.is_relative_to(DOCS)} - reached
    assert not left_out, f"in no toctree: {sorted(map(named, left_out))}"


def command_lines(path: Path) -> list[str]:
    """Every `aerokernels ...` of a page: in blocks, behind a `!`, and in backticks."""
    lines = []
    for kind, body in blocks(path):
        if kind in ("", "sh", "bash", "indented", "console") or kind.startswith("{code-cell}"):
            joined = re.sub(r"\\\n\s*", " ", body)
            python = kind.startswith("{code-cell}") and "%%bash\n" not in body
            for line in (line for line in joined.splitlines() if line.startswith("!") or not python):
                line = line.strip().removeprefix("!").removeprefix("$ ")
                lines += [part for part in re.split(r";\s*(?:do|done)?|&&|\|", line) if "aerokernels " in part]
    lines += [text for text in re.findall(r"`([^`]+)`", prose_of(path)) if text.startswith("aerokernels ")]
    return [line[line.index("aerokernels ") :].strip() for line in lines if re.search(r"(?:^|[\s/])aerokernels ", line)]


@pytest.mark.parametrize("path", PAGES, ids=named)
def test_commands_and_options_exist(path: Path):
    import command_pages
    import scene_pages

    known, keys = command_pages.commands(), scene_pages.keys()
    for line in command_lines(path):
        try:
            words = shlex.split(line, comments=True)[1:]
        except ValueError:
            words = line.split()[1:]
        if not words or not re.fullmatch(r"[a-z]+", words[0]) or words[0].isupper():
            continue
        assert words[0] in known, f"{line}: no such command"
        options = command_pages.options(known[words[0]])
        for number, word in enumerate(words):
            if re.match(r"--[a-z]", word):
                assert word.partition("=")[0].rstrip(",.]") in options | {"--debug"}, f"{line}: no such option"
            if number and words[number - 1] in ("--set", "--vary") and "=" in word and word[0].islower():
                assert word.partition("=")[0] in keys, f"{line}: no such key of a scene"


@pytest.mark.parametrize("path", PAGES, ids=named)
def test_scene_keys_exist(path: Path):
    """Keys in backticks (`target.tilt`) and TOML blocks."""
    import scene_pages

    keys, tables = scene_pages.keys(), set(scene_pages.tables()) - {""}
    texts = [body for kind, body in blocks(path) if kind == "toml"]
    texts += [body.split("\n", 1)[1] for _, body in blocks(path) if re.match(r"%%writefile \S+\.toml\n", body)]
    for text in texts:
        for table, values in tomllib.loads(text).items():
            assert table in keys, table
            for key, value in values.items() if isinstance(values, dict) else []:
                assert f"{table}.{key}" in keys, f"{table}.{key}"
                for inner in value if isinstance(value, dict) else []:
                    assert f"{table}.{key}.{inner}" in keys, f"{table}.{key}.{inner}"
    for name in re.findall(r"`([a-z]+\.[a-z_.]+)(?: = [^`]*)?`", prose_of(path)):
        if name.partition(".")[0] in tables - {"flow", "echo", "series", "trace", "strehl"} and not name.endswith(
            (".md", ".py", ".png", ".nc")
        ):
            assert name in keys, f"`{name}` is no key of a scene"


def python_blocks(path: Path) -> list[str]:
    """Python of a page, its cells joined as they are executed."""
    plain = [body for kind, body in blocks(path) if kind == "python"]
    cells = [body for kind, body in blocks(path) if kind.startswith("{code-cell}") and "%%" not in body]
    lines = "\n".join(re.sub(r"\A(?::[^\n]*\n)+", "", body) for body in cells).splitlines()
    joined = "\n".join(line for line in lines if not line.lstrip().startswith("!"))
    return plain + ([joined] if joined.strip() else [])


def names_of_the_package(tree: ast.AST) -> list[str]:
    """Full names under `aerokernels` that a piece of Python imports or reaches through an imported module."""
    known, found = {}, []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.partition(".")[0] == "aerokernels":
                    known[alias.asname or "aerokernels"] = alias.name if alias.asname else "aerokernels"
                    found.append(alias.name)
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "aerokernels":
            for alias in node.names:
                known[alias.asname or alias.name] = f"{node.module}.{alias.name}"
                found.append(f"{node.module}.{alias.name}")
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in known:
            found.append(f"{known[node.value.id]}.{node.attr}")
    return found


def exists(name: str) -> bool:
    """Whether a dotted name leads to a module or to something in one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(thing, part) and part not in getattr(thing, "__annotations__", {}):
                return False
            thing = getattr(thing, part, None)
        return True
    return False


def keywords_of(tree: ast.AST) -> list[tuple[str, set[str]]]:
    """Calls of public functions by a name that is imported from the package: full name and keywords."""
    homes = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "aerokernels":
            homes |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
        if isinstance(node, ast.Import):
            homes |= {alias.name: alias.name for alias in node.names if alias.name == "aerokernels"}
    calls = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        target = ast.unparse(node.func)
        first, _, rest = target.partition(".")
        if first in homes:
            full = homes[first] + (f".{rest}" if rest else "")
            calls.append((full, {keyword.arg for keyword in node.keywords if keyword.arg}))
    return calls


@pytest.mark.parametrize("path", [path for path in PAGES if python_blocks(path)], ids=named)
def test_python_of_pages_uses_names_and_keywords_that_exist(path: Path):
    import inspect

    for text in python_blocks(path):
        tree = ast.parse(text)
        for name in names_of_the_package(tree):
            assert exists(name), f"{named(path)}: {name}"
        for name, keywords in keywords_of(tree):
            home, _, last = name.rpartition(".")
            try:
                thing = getattr(importlib.import_module(home), last)
                parameters = inspect.signature(thing).parameters
            except (ModuleNotFoundError, AttributeError, ValueError, TypeError):
                continue  # a method of an object, which only running the page can find
            if not any(one.kind is one.VAR_KEYWORD for one in parameters.values()):
                assert keywords <= set(parameters), f"{named(path)}: {name}({', '.join(keywords - set(parameters))}=)"


def test_every_generated_table_has_a_record():
    """Tables between markers are made by a command; docs/validation/made.toml names it."""
    import validation_pages

    recorded = {page for record in validation_pages.records().values() for page in record["pages"]}
    for path in PAGES:
        if re.search(r"^<!-- [\w-]+:begin -->$", path.read_text(encoding="utf-8"), flags=re.MULTILINE):
            assert named(path) in recorded, named(path)
