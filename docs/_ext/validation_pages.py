"""The page that says of every generated table and picture: which command made it, and at which commit.

`docs/validation/made.toml` holds the records; `scripts/docs --remake NAME` runs a command and writes the commit down.
"""

import subprocess
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RECORDS = ROOT / "docs" / "validation" / "made.toml"


def records(path: Path = RECORDS) -> dict[str, dict[str, Any]]:
    """What is made, by name: pages, command, commit, date, minutes, sources."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def changes_since(commit: str, sources: list[str]) -> int | None:
    """How many commits have changed the sources since; None where that cannot be known (no git, a shallow clone)."""
    try:
        done = subprocess.run(
            ["git", "rev-list", "--count", f"{commit}..HEAD", "--", *sources], cwd=ROOT, capture_output=True, text=True
        )
    except OSError:
        return None
    return int(done.stdout) if done.returncode == 0 and done.stdout.strip().isdigit() else None


def page() -> str:
    """The page."""
    lines = [
        "# What was made when",
        "",
        "Every number of the validation pages comes out of a command. This page is made from `docs/validation/made.toml` and the history of "
        "the code: it says which command made a table, at which commit, and how many commits have changed the code behind it since. "
        "`scripts/docs --remake NAME` runs the command again and writes the commit down. A table whose code has changed since is still "
        "what that commit gave; it is made again before a release.",
        "",
        "| name | page | command | minutes | made at | changes of its code since |",
        "|---|---|---|---:|---|---:|",
    ]
    for name, record in records().items():
        since = changes_since(record["commit"], record["sources"])
        pages = ", ".join(f"[{Path(page).stem}](../{Path(page).relative_to('docs')})" for page in record["pages"])
        lines.append(
            f"| {name} | {pages} | `{record['command']}` | {record['minutes']} | `{record['commit']}`, {record['date']} | "
            f"{'unknown' if since is None else since} |"
        )
    return "\n".join(lines) + "\n"
