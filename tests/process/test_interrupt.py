"""Signals that end a command: at moments at which an exception from a handler does harm, they wait.

Each test runs a child that sends itself a signal at such a moment, or is sent one, and expects what `main` in cli.py
relies on: one KeyboardInterrupt in the end, and the exit status that the child chose.
"""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

CHILD = """
import os, signal, sys, time
from aerokernels.process.interrupt import raise_interrupts

def send():
    os.kill(os.getpid(), {signal})
    for _ in range(1000):
        pass  # handlers run between steps of Python

def main():
    raised = raise_interrupts()
    try:
        {moment}
        time.sleep(30.0)
    except KeyboardInterrupt:
        print("ended by", *raised)
        raise SystemExit(99) from None

main()
"""


def run_child(folder: Path, moment: str, number: int) -> subprocess.CompletedProcess[str]:
    (folder / "child.py").write_text(CHILD.format(signal=int(number), moment=moment))
    command = [sys.executable, "-m", "child"]  # as a module, for which Python has an end of its own
    return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", timeout=25.0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "moment", ["import slow", "import h5netcdf; h5netcdf.write()", "exec('send()', globals())", "send()"]
)
def test_a_signal_ends_a_command_once_wherever_it_comes(tmp_path: Path, moment: str, number: int):
    """Within an import, a library that writes, text that is run; elsewhere."""
    (tmp_path / "slow.py").write_text("import __main__\n__main__.send()\nprint('done whole')\n")
    (tmp_path / "h5netcdf").mkdir()
    (tmp_path / "h5netcdf" / "__init__.py").write_text(
        "import __main__\ndef write():\n    __main__.send()\n    print('done whole')\n"
    )
    done = run_child(tmp_path, moment, number)
    assert done.returncode == 99 and done.stderr == ""
    whole = ["done whole"] if "slow" in moment or "write" in moment else []
    assert done.stdout.splitlines() == [*whole, f"ended by {int(number)}"]


def test_imports_ahead_are_waited_for_and_not_begun_when_a_process_leaves(tmp_path: Path):
    """The module at hand is imported whole, and the next one not at all."""
    (tmp_path / "first.py").write_text("import time\ntime.sleep(0.5)\nprint('first', flush=True)\n")
    (tmp_path / "second.py").write_text("print('second', flush=True)\n")
    program = "from aerokernels.commands._output import import_ahead; import_ahead(('first', 'second'))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, encoding="utf-8", timeout=60.0
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "first\n", "")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs on_exit of the C library")
def test_a_signal_that_waits_when_a_process_leaves_changes_nothing_of_its_status(tmp_path: Path):
    """It comes in an import that leaves, before libraries that take a second to do so: no SIGALRM ends the process."""
    (tmp_path / "slow.py").write_text(
        "import __main__, ctypes, sys\n"
        "c = ctypes.CDLL(None)\n"
        "c.on_exit(c.sleep, None)\n"  # called with the exit status: sleeps for a second
        "__main__.send()\n"
        "sys.exit(1)\n"
    )
    assert run_child(tmp_path, "import slow", signal.SIGTERM).returncode == 1
