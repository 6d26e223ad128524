"""`aerokernels` and `python -m aerokernels`: the command line."""

import signal
from typing import NoReturn

from aerokernels.interrupt import heeded


def main() -> NoReturn:
    """Run the command line; an interrupt while it is still imported ends the process without a traceback."""
    if heeded(signal.SIGINT):
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from aerokernels.cli import main as command_line

    command_line()


if __name__ == "__main__":
    main()
