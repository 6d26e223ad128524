"""Forks while another thread holds a lock of this package: the child has no such thread, and must not wait for it."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from aerokernels.process import forks
from aerokernels.process.forks import make_forks_safe
from aerokernels.process.opened import OPENED, Opened

make_forks_safe()  # as the first call of a public function does
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")

# A thread's first trace, in which an import takes 2 s, and a fork in the midst of it.
FIRST_TRACE = """
import os, sys, threading, time
from aerokernels import IndexField, Plane, RayBundle, trace
backend, slow = sys.argv[1:]
began = threading.Event()
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == slow and not began.is_set():
            began.set()
            time.sleep(2.0)
sys.meta_path.insert(0, Slow())
def first():
    field = IndexField.from_samples([[0.0, 1e-5]] * 3, origin=(-1, 0), spacing=(1, 1), geometry="planar")
    rays = RayBundle([[0, 0, -2.0]], [[0, 0, 1.0]])
    try:
        return len(trace(field, rays, until=Plane((0, 0, 2.0), (0, 0, 1)), method="adaptive", backend=backend).status)
    except ValueError as refused:
        return str(refused)
thread = threading.Thread(target=first)
thread.start()
began.wait()
child = os.fork()
found = first()
if child:
    thread.join()
os.write(1, f"{'parent' if child else 'child'} {found}\\n".encode())  # in one piece: both write to one pipe
if not child:
    os._exit(0)
os.waitpid(child, 0)
"""


def test_an_import_adds_nothing_to_a_programs_forks():
    """Before each fork of a program that only imports the package nothing of it runs, and nothing after."""
    script = (
        "import os; told = []; os.register_at_fork = lambda **given: told.extend(given.values())\n"
        "import aerokernels\n"
        "for name in aerokernels.__all__: getattr(aerokernels, name)\n"
        "assert not [one for one in told if str(one.__module__).startswith('aerokernels')], told\n"
        "aerokernels.Disc(1e-3)\n"
        "assert [one for one in told if one.__module__ == 'aerokernels.process.forks']\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=100.0)


def child_answers(ask) -> bool:
    """Whether a forked child returns from a call within 10 s."""
    child = os.fork()
    if not child:
        ask()
        os._exit(0)
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        if os.waitpid(child, os.WNOHANG)[0]:
            return True
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def test_a_child_of_a_process_that_opens_something_opens_its_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(forks, "PATIENCE", 0.5)
    began, ends = threading.Event(), threading.Event()

    def hold() -> None:
        with OPENED.lock:
            began.set()
            ends.wait(60.0)

    def ask() -> None:
        with OPENED.lock:
            pass

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        assert began.wait(10.0) and child_answers(ask)
    finally:
        ends.set()
        thread.join()


@pytest.mark.parametrize(
    ("backend", "slow"),
    [
        pytest.param("warp", "aerokernels.tracing.engines.warp.engine", marks=pytest.mark.slow),
        ("opencl", "pyopencl"),
    ],
)
def test_a_fork_in_the_first_trace_of_another_thread(backend: str, slow: str):
    """Expected: the parent's trace ends; the child traces too, or its refusal says what a forked process cannot do.

    The child waited for ever for the lock of an import whose thread it does not have.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", FIRST_TRACE, backend, slow], stdout=subprocess.PIPE, start_new_session=True, text=True
    )
    try:
        said = process.communicate(timeout=100.0)[0].splitlines()
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    assert process.returncode == 0 and "parent 1" in said
    assert [line for line in said if line.startswith("child 1" if backend == "warp" else "child backend 'opencl' ")]


def test_a_fork_waits_for_what_another_thread_opens():
    """Expected: what is opened for once is there after the fork, in both processes."""
    opened, began = Opened(), threading.Event()

    def make() -> str:
        began.set()
        time.sleep(1.0)
        return "made"

    thread = threading.Thread(target=opened.once, args=("key", make))
    thread.start()
    began.wait(10.0)
    child = os.fork()
    if not child:
        os._exit(0 if opened.get("key") == "made" else 1)
    assert opened.get("key") == "made" and os.waitpid(child, 0)[1] == 0
    thread.join()


def test_a_fork_waits_no_longer_than_it_is_worth(monkeypatch: pytest.MonkeyPatch):
    """A thread that opens something may itself wait for the one that forks; nor does a thread wait for others then."""
    monkeypatch.setattr(forks, "PATIENCE", 0.5)
    opened, began, ends = Opened(), threading.Event(), threading.Event()
    thread = threading.Thread(target=opened.once, args=("key", lambda: began.set() or ends.wait(60.0)))
    thread.start()
    try:
        assert began.wait(10.0) and child_answers(lambda: None)
        monkeypatch.setattr(forks, "PATIENCE", 1e9)
        assert Opened().once("fork", lambda: child_answers(lambda: None))
    finally:
        ends.set()
        thread.join()
