"""The script that puts recording to the test in full still runs, and passes, in small."""

import subprocess
import sys
from pathlib import Path

import pytest

from .line import needs_pseudo_terminals


@needs_pseudo_terminals
@pytest.mark.slow
def test_the_soak_script_in_small(root: Path, tmp_path: Path):
    done = subprocess.run(
        [sys.executable, str(root / "scripts" / "hardware_soak.py"), "--quick", "--out", str(tmp_path / "out")],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=300.0,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    table = (tmp_path / "out" / "table.md").read_text(encoding="utf-8")
    assert table in done.stdout and table.count("| ok ") == 6 and "FAILED" not in table
