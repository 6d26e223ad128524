"""A worker process: takes cases from a pipe, one at a time, until the pipe is closed.

Run as `python -m aerokernels.jobs.sweeps.worker DESCRIPTOR`. It is no child of `multiprocessing`, so that a script
that calls `sweep` needs no guard against being imported again.
"""

import sys
from multiprocessing.connection import Connection


def serve(pipe: Connection) -> None:
    """Compute what comes until nothing more does."""
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
            return  # whoever asked is gone


if __name__ == "__main__":
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: the parent ends its workers itself
    serve(Connection(int(sys.argv[1])))
