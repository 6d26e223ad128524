"""The page that says of every generated table and picture which command made it, where and when.

`docs/validation/made.toml` holds the records; `scripts/docs --remake NAME` runs a command and notes the date.
"""

import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RECORDS = ROOT / "docs" / "validation" / "made.toml"


def records(path: Path = RECORDS) -> dict[str, dict[str, Any]]:
    """What is made, by name: pages, results, command, minutes, machine, date, sources."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def page() -> str:
    """The page."""
    lines = [
        "# What was made where and when",
        "",
        "Every number of the validation pages comes from a command, on the machine and at the date below. `scripts/docs --remake NAME` "
        "runs a command again and notes the date. Tables are made again before a release.",
        "",
        "| name | page | command | minutes | machine | date |",
        "|---|---|---|---:|---|---|",
    ]
    for name, record in records().items():
        pages = ", ".join(f"[{Path(page).stem}](../{Path(page).relative_to('docs')})" for page in record["pages"])
        lines.append(
            f"| {name} | {pages} | `{record['command']}` | {record['minutes']} | {record['machine']} | {record['date']} |"
        )
    return "\n".join(lines) + "\n"
