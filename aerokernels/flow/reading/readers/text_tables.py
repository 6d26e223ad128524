"""Read tables in text: a line of names, then lines of numbers, separated by commas, semicolons, tabs or blanks."""

import csv
import re
import warnings
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import ReadError

DAMAGED = "write it again with a line of names and as many numbers in every line"
_LETTER_LEFT_OUT = re.compile(r"(?<=[\d.])(?=[+-]\d{3}(?![\d.]))")


def read_table(path: Path, data: bytes | None = None) -> dict[str, np.ndarray]:
    """Return the columns of a table by name.

    Raises:
        ReadError: Not a text, no names, lines of unequal length, or entries that are not numbers.
    """
    data = path.read_bytes() if data is None else data
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise ReadError(path, f"it is not a text (byte {fault.start})", DAMAGED) from None
    if "\0" in text:
        raise ReadError(path, "it is not a text: it contains zero bytes", DAMAGED)
    written = [(k + 1, line) for k, line in enumerate(text.splitlines()) if line.strip()]
    lines = [(number, line) for number, line in written if not line.lstrip().startswith("#")]
    if lines and _all_numbers(lines[0][1]):  # the names are in a comment above, as numpy.savetxt writes them
        above = [(number, line.lstrip().lstrip("#")) for number, line in written if number < lines[0][0]]
        lines = above[-1:] + lines
    if len(lines) < 2:
        raise ReadError(path, "it has no line of names with lines of numbers below it", DAMAGED)
    head = lines[0][1]
    mark = next((mark for mark in (",", ";", "\t") if mark in head), None)
    names = [
        word.strip().strip('"').strip() for word in (next(csv.reader([head], delimiter=mark)) if mark else _words(head))
    ]
    if names[0] == "" and len(names) > 1:
        names[0] = "index"  # pandas writes the index of rows without a name
    if len(set(names)) < len(names) or not all(names) or all(_is_number(name) for name in names):
        raise ReadError(path, f"its first line has no names that are all different: {head[:80]!r}", DAMAGED)
    rows = np.empty((len(lines) - 1, len(names)))
    mark = next((mark for mark in (";", ",", "\t") if mark in lines[1][1]), None)  # may differ from that of the names
    for k, (number, line) in enumerate(lines[1:]):
        words = line.split(mark) if mark else line.split()
        if mark == ";":  # then a comma is the decimal mark
            words = [word.replace(",", ".") for word in words]
        if len(words) == len(names) + 1 and not words[-1].strip():
            words.pop()  # some programs end every line with a comma
        try:
            if len(words) != len(names):  # NumPy would broadcast a single number to the whole row
                raise ValueError
            rows[k] = [float(word) for word in words]
        except ValueError:
            raise ReadError(path, f"line {number}: expected {len(names)} numbers, got {line[:60]!r}", DAMAGED) from None
    return {name: rows[:, k].copy() for k, name in enumerate(names)}


def fortran_numbers(text: str) -> np.ndarray:
    """Return the numbers of a text, separated by blanks, also with exponents as only Fortran writes them.

    These have the letter D, or no letter before three digits: 1.5D+00, 1.5-101.

    Raises:
        ValueError: Something that is not a number.
    """
    text = text.replace("D", "E").replace("d", "e")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for written in (lambda: text, lambda: _LETTER_LEFT_OUT.sub("E", text)):  # the second takes longer
            try:
                return np.fromstring(written(), sep=" ")
            except (DeprecationWarning, ValueError) as fault:
                found = fault
    raise ValueError(str(found))


def _words(line: str) -> list[str]:
    return next(csv.reader([" ".join(line.split())], delimiter=" "))


def _all_numbers(line: str) -> bool:
    return all(_is_number(word) for word in re.split(r"[,;\s]+", line.strip(" \t,;")))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
