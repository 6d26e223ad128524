"""Processes started without standard streams, or with one that takes nothing: for real, by a shell."""

import os
import subprocess
import sys

import numpy as np
import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="no POSIX shell here")


def by_shell(ending: str, folder, *line: str) -> subprocess.CompletedProcess[str]:
    command = ["sh", "-c", f'"$@" {ending}', "sh", sys.executable, *line]
    return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", timeout=120)


@pytest.mark.parametrize("ending", ["2>&-", "2>&- <&-", ">&- 2>&- <&-"])
def test_what_a_library_prints_is_not_written_into_results(ending, tmp_path):
    code = (
        "import os\n"
        "from aerokernels.process.interrupt import open_closed_streams\n"
        "open_closed_streams()\n"
        "with open('result', 'wb', buffering=0) as file:\n"
        "    os.write(2, b'a library in C prints')\n"
        "    file.write(b'result')\n"
    )
    by_shell(ending, tmp_path, "-c", code)
    assert (tmp_path / "result").read_bytes() == b"result"


def test_pictures_are_made_without_stdin_and_stderr(tmp_path):
    """It failed without a word: "'NoneType' object has no attribute 'isatty'"."""
    np.savez(tmp_path / "flow.npz", x=np.arange(5.0), y=np.arange(4.0), rho=1.0 + np.arange(20.0).reshape(5, 4))
    line = "-m", "aerokernels", "fields", "flow.npz", "--picture", "flow.png"
    assert by_shell("2>&- <&-", tmp_path, *line).returncode == 0 and (tmp_path / "flow.png").stat().st_size > 1000


def test_warp_starts_without_stderr(tmp_path):
    code = "from aerokernels.process.quiet_warp import start_warp; start_warp(); print('started')"
    assert by_shell("2>&- <&-", tmp_path, "-c", code).stdout == "started\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_results_that_stdout_does_not_take_are_a_failure(tmp_path):
    """`aerokernels scenes > file` on a full disk left an empty file, with exit status 0."""
    done = by_shell(">/dev/full", tmp_path, "-m", "aerokernels", "scenes", "--json")
    assert done.returncode == 1 and "could not be written to stdout (No space left" in done.stderr
    assert by_shell("| true", tmp_path, "-m", "aerokernels", "scenes").returncode == 0
