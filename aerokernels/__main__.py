"""`aerokernels` and `python -m aerokernels`: the command line."""

import signal
import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line; an interrupt while it is still imported ends the process without a traceback."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from aerokernels.cli import main as command_line

    command_line()


if __name__ == "__main__":
    # `python -m` puts the working directory on the path: what is imported from here on, also in children, is not there.
    if not sys.flags.safe_path:
        del sys.path[0]
    main()
