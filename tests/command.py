"""The command line in this process, which saves its start: for all that needs no process of its own."""

import contextlib
import gc
import io
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import TextIO
from unittest import mock


def command(folder: Path, *arguments: object, screen: TextIO | None = None) -> subprocess.CompletedProcess[str]:
    """Run `aerokernels` with arguments in a folder, and return its status and what it wrote, not to a screen."""
    from aerokernels import cli
    from aerokernels.commands._output import output
    from aerokernels.process.interrupt import STOPPING

    threshold, handlers = gc.get_threshold(), {one: signal.getsignal(one) for one in STOPPING}
    out, err = (screen or io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    status = None
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        mock.patch.object(sys, "argv", ["aerokernels", *map(str, arguments)]),
        mock.patch.dict(os.environ),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("default")
        try:
            cli.main()
        except SystemExit as left:
            status = left.code
        finally:
            gc.set_threshold(*threshold)
            for number, handler in handlers.items():
                signal.signal(number, handler)
            output.as_json, output.quiet, output.lost = False, False, ""
    said = ("" if stream is screen else stream.buffer.getvalue().decode() for stream in (out, err))  # type: ignore[attr-defined]
    return subprocess.CompletedProcess(arguments, status, *said)  # type: ignore[arg-type]
