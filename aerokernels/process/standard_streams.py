"""Open the null device in place of standard streams that the process was started without, as some services are.

The next file to be opened would take the number of a closed stream, and what a library in C prints would be written
into that file.
"""

import os
import sys

STREAMS = ("stdin", "r"), ("stdout", "w"), ("stderr", "w")  # of the file descriptors 0, 1 and 2


def open_closed_streams() -> None:
    """Open the null device for each standard stream that is closed, for C and for Python."""
    for number in range(len(STREAMS)):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest free number, which is this one
    for number, (name, mode) in enumerate(STREAMS):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", errors="replace", closefd=False))
