"""A type checker accepts README's ten lines, strictly, as a user's project would check them."""

import re
from pathlib import Path

import pytest


@pytest.mark.slow
def test_a_type_checker_accepts_the_readme(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    api = pytest.importorskip("mypy.api")
    snippets = re.findall(r"```python\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    assert snippets
    for number, snippet in enumerate(snippets):
        (tmp_path / f"snippet_{number}.py").write_text(snippet, encoding="utf-8")
    monkeypatch.chdir(root)  # its settings, and what it keeps from checking the package itself
    files = [str(path) for path in sorted(tmp_path.glob("snippet_*.py"))]
    said, fault, status = api.run(["--strict", "--follow-imports=silent", *files])
    assert status == 0, said + fault
