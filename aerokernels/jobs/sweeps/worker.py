"""A worker process that computes cases from a pipe, one at a time, until the pipe is closed.

Run as `python -m aerokernels.jobs.sweeps.worker DESCRIPTOR`. It is not started by `multiprocessing`, so that a script
that calls `sweep` needs no `if __name__ == "__main__"` guard.
"""

import sys
from multiprocessing.connection import Connection


def serve(pipe: Connection) -> None:
    """Compute the cases that arrive until the pipe is closed."""
    from aerokernels.jobs.sweeps.case import compute

    pipe.send("ready")
    while True:
        try:
            case = pipe.recv()
        except (EOFError, OSError):
            return
        outcome = compute(case)
        try:
            pipe.send(outcome)
        except (BrokenPipeError, OSError):
            return  # the parent process is gone


if __name__ == "__main__":
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group: the parent ends its workers
    serve(Connection(int(sys.argv[1])))
