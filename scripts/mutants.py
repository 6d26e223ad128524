"""Plant known faults in a copy of the package, one at a time, and count those that the tests catch.

    scripts/mutants [--workers N] [--only TEXT]      one line a fault that no test caught, then the count; exit status 0

The faults are in scripts/mutants.toml: a line of the package, what is put in its place, and the tests that ought to
notice. A fault is caught where a test fails, or where the tests do not end within the time. A line that stands in
no file any more, or in several, is named and not counted.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TREES = ("aerokernels", "kernels", "tests", "scripts")


def planted(line: str, put: str, root: Path) -> Path | None:
    """Replace the only occurrence of `line` in a copy's package; return its file, None where it is not the only one."""
    places = [
        (path, number)
        for path in (root / "aerokernels").rglob("*.py")
        for number, text in enumerate(path.read_text(encoding="utf-8").splitlines())
        if text.strip() == line
    ]
    if len(places) != 1:
        return None
    path, number = places[0]
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[number] = lines[number].replace(line, put)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def outcome(mutant: dict[str, str], limit: float) -> str:
    """Return "caught", "survived" or "not found" for one fault."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for tree in TREES:
            shutil.copytree(ROOT / tree, root / tree, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", root)
        if planted(mutant["line"], mutant["put"], root) is None:
            return "not found"
        tests = [path for path in mutant["tests"].split() if (root / path).exists()]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *tests]
        settings = {**os.environ, "PYTHONPATH": os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")])}
        try:
            ended = subprocess.run(command, cwd=root, env=settings, capture_output=True, timeout=limit, check=False)
        except subprocess.TimeoutExpired:
            return "caught"
        return "survived" if ended.returncode == 0 else "caught"


def main() -> None:
    """Read the faults, try each in its own copy, and print what was not caught."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="faults whose line or tests hold this text")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds that the tests of one fault may take")
    chosen = parser.parse_args()
    groups = tomllib.loads((ROOT / "scripts" / "mutants.toml").read_text(encoding="utf-8"))["group"]
    mutants = [
        {"line": line, "put": put, "tests": group["tests"]}
        for group in groups
        for line, put in group["faults"]
        if chosen.only in line + group["tests"]
    ]
    with ThreadPoolExecutor(chosen.workers) as pool:
        outcomes = list(pool.map(lambda mutant: outcome(mutant, chosen.limit), mutants))
    for mutant, result in zip(mutants, outcomes, strict=True):
        if result != "caught":
            print(f"{result}: {mutant['line']}  ->  {mutant['put']}  ({mutant['tests']})")
    counts = {name: outcomes.count(name) for name in ("caught", "survived", "not found")}
    print(", ".join(f"{count} {name}" for name, count in counts.items()))


if __name__ == "__main__":
    main()
