"""The types that a type checker infers in README's lines and in the tutorials' cells: no result of ours is Any."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
CELL = re.compile(r"^```(?:python|\{code-cell\}[^\n]*)\n(?:---\n.*?---\n)?(.*?)^```", re.MULTILINE | re.DOTALL)
# Matplotlib's axes of several panels, parsed JSON and subprocesses are Any to every type checker.
OTHERS = re.compile(r"plt\.|panel|axes|json\.|subprocess|IPython|getattr")


def code_of(page: Path) -> str:
    """Return the Python of a page, without cell options and cells of the shell."""
    cells = [cell for cell in CELL.findall(page.read_text(encoding="utf-8")) if "%%" not in cell]
    return "\n".join(re.sub(r"^(:|[!%]).*\n", "", cell, flags=re.MULTILINE) for cell in cells)


def names_in(code: str) -> list[str]:
    """Return the names that the code's statements assign, outside functions and comprehensions."""
    found: dict[str, None] = {}
    tree = ast.parse(code)
    own = {f"{one.name}(" for one in tree.body if isinstance(one, ast.FunctionDef)}  # a page's functions state no types
    for statement in tree.body:
        if any(call in ast.unparse(statement) for call in own):
            continue
        if isinstance(statement, (ast.Assign, ast.AnnAssign)) and not OTHERS.search(ast.unparse(statement)):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            nodes = [node for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
            found |= dict.fromkeys(node.id for node in nodes if isinstance(node.ctx, ast.Store))
    return list(found)


@pytest.mark.slow
def test_every_name_of_the_first_pages_has_a_type(tmp_path):
    """Expected: mypy reveals a class for each name; before, `flow.shipped("mach3").scaled(1.225)` was Any."""
    asked = 0
    for page in PAGES:
        code = code_of(page)
        asked += len(names := names_in(code))
        lines = "\n".join(f"reveal_type({name})  # {name}" for name in names)
        (tmp_path / f"{page.stem.replace('-', '_')}.py").write_text(f"{code}\n{lines}\n", encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "--follow-imports=silent"]
    files = sorted(map(str, tmp_path.glob("*.py")))
    said = subprocess.run([*command, *files], cwd=ROOT, capture_output=True, text=True).stdout
    revealed = re.findall(r"([^/\n]*\.py:\d+): note: Revealed type is \"(.*)\"", said)
    assert asked > 40 and len(revealed) == asked, said
    assert [place for place, kind in revealed if kind == "Any"] == []
