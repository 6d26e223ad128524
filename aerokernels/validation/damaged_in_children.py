"""Damaged flow files by the thousand, read in a child process that may die of them.

The child is forked from a process that has imported the readers and their libraries: a new one costs milliseconds, and
within it a case costs what reading the file does. A library that ends the process on a damaged file ends the child
only; in `flow.read` itself that is a refusal, since such libraries run in a process of their own there
(aerokernels/fragile.py). A child that ends, or takes too long, anywhere else is a fault of this package.
"""

import os
import select
import shutil
import signal
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .. import fragile
from ..flow.reading import formats
from ..flow.reading.calling import read_here
from .damaged_files import damage, outcome_of
from .damaged_structure import damage_structure, has_structure
from .forked_readers import addresses

# What a child says, one byte each; after FAULT comes a text.
LOADED, READ, REFUSED, FAULT = b"L", b"r", b"x", b"F"
LONGEST = 40.0  # [s] that a case may take; a library's own bound is below it
CASES_A_CHILD = 2000  # what libraries leak goes with the child


def load(path: Path) -> None:
    """Read a sound file in this process, so that children that are forked from it have its libraries."""
    in_child, vars(formats)["in_child"] = formats.in_child, read_here
    try:
        if outcome_of(path) != "read":
            raise ValueError(f"{path} is not sound")
    finally:
        vars(formats)["in_child"] = in_child


def outcomes(path: Path, sound: Path, copy: Path, seeds: Iterable[int]) -> Iterator[str]:
    """The outcomes of damaged copies of a sound file or case, one for each seed: "read", "refused" or "ended".

    "ended" is a refusal because the library that reads the file ended its process, or was ended by the bounds on it.
    After an error, the seeds behind it can be gone on with by another call.

    Args:
        path: The file, or the case's folder; `load` tells whether it is sound.
        sound: The folder with all that belongs to it; one of its files is damaged each time.
        copy: Where the copies are made.
        seeds: What tells one damage from another.

    Raises:
        RuntimeError: Anything else became of a copy: the seed, the damaged file, and what it was.
    """
    files = sorted(file for file in sound.rglob("*") if file.is_file())
    contents = {file: file.read_bytes() for file in files}
    fragile = formats.format_of(path, {}).fragile
    left = list(seeds)
    while left:
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(sound, copy)
        some = left[:CASES_A_CHILD]
        done = 0
        for found in _by_a_child(path, sound, copy, contents, some, fragile):
            done += 1
            yield found
        left = left[done:]


def _by_a_child(path: Path, sound: Path, copy: Path, contents, seeds: list[int], fragile: bool) -> Iterator[str]:
    """Outcomes in order until all seeds are done, or the child has ended."""
    listens, speaks = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(listens)
        _serve(speaks, path, sound, copy, contents, seeds)
    os.close(speaks)
    try:
        for seed in seeds:
            said = _hear(listens)
            if loaded := said == LOADED:
                said = _hear(listens)
            if said in (READ, REFUSED):
                yield "read" if said == READ else "refused"
                continue
            if said == FAULT:
                with os.fdopen(os.dup(listens), "r", errors="replace") as stream:
                    raise RuntimeError(f"seed {seed}: {stream.read()}")
            if said is None:
                os.kill(child, signal.SIGKILL)
            status, child = os.waitpid(child, 0)[1], 0
            # A library may have spoiled its memory, and the process ends when that is given back: by a signal.
            of_library = said is not None and os.WIFSIGNALED(status)
            if not fragile or (loaded and not of_library):
                how = f"the process ended with {status}" if said is not None else f"it took longer than {LONGEST:g} s"
                raise RuntimeError(f"seed {seed}: {how} {'after the file was read' if loaded else 'while reading'}")
            yield "ended"
            return
    finally:
        if child:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        os.close(listens)


def _hear(pipe: int) -> bytes | None:
    """What the child says next; nothing where it has ended, None where it takes too long."""
    if not select.select([pipe], [], [], LONGEST)[0]:
        return None
    return os.read(pipe, 1)


def _serve(speaks: int, path: Path, sound: Path, copy: Path, contents, seeds: list[int]) -> None:
    """Be the child: never returns."""
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 1)
    os.dup2(null, 2)

    inherited = addresses()

    def read_in_here(module: str, file: Path, time, options: dict[str, Any]):
        fragile.limit(fragile.bounds_of(file), inherited)
        try:
            return read_here(module, file, time, options)
        finally:
            _lift()
            os.write(speaks, LOADED)

    vars(formats)["in_child"] = read_in_here  # this process is the one that may die
    files = sorted(contents)
    for seed in seeds:
        random = np.random.default_rng(seed)
        chosen = files[int(random.integers(len(files)))]
        damaged = copy / chosen.relative_to(sound)
        try:
            structural = has_structure(contents[chosen]) and random.random() < 0.5
            damaged.write_bytes((damage_structure if structural else damage)(contents[chosen], random))
            found = READ if outcome_of(copy / path.relative_to(sound)) == "read" else REFUSED
            damaged.write_bytes(contents[chosen])
            os.write(speaks, found)
        except BaseException:
            os.write(speaks, FAULT + f"{chosen.name}: {traceback.format_exc()}".encode())
            os._exit(1)
    os._exit(0)


def _lift() -> None:
    """Take the bounds of `fragile` back."""
    import resource

    for what in (resource.RLIMIT_AS, resource.RLIMIT_CPU):
        hard = resource.getrlimit(what)[1]
        resource.setrlimit(what, (hard, hard))
