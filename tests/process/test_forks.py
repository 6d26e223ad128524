"""Forks while another thread holds a lock of this package: the child has no such thread, and must not wait for it."""

import os
import signal
import threading
import time

import pytest

from aerokernels.process.opened import OPENED


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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.parametrize("owner", ["opened", "Warp kernels"])
def test_a_child_of_a_process_that_opens_something_opens_its_own(owner):
    from aerokernels.tracing.engines.warp.library import library_of

    held = OPENED if owner == "opened" else library_of("float32")
    began, ends = threading.Event(), threading.Event()

    def hold() -> None:
        with held.lock:
            began.set()
            ends.wait(60.0)

    def ask() -> None:
        with held.lock:
            pass

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        assert began.wait(10.0) and child_answers(ask)
    finally:
        ends.set()
        thread.join()
