"""Parse one file of an OpenFOAM case: its header, and lists and words at a cursor, in ascii and binary.

The format: a dictionary FoamFile {...} with `format` and `arch`, then entries. A list is a count and its entries in
brackets, `3(1 2 3)`; in binary files the entries between the brackets are raw numbers, whose sizes `arch` states
("LSB;label=32;scalar=64").
"""

import gzip
import re
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import ReadError, starts_of, whole_number

_BLANK = re.compile(rb"(?:\s+|//[^\n]*\n?|/\*.*?\*/)*", re.DOTALL)
_WORD = re.compile(rb'"[^"\n]*"|[^\s(){};"]+')
WIDTH = {"scalar": 1, "vector": 3, "symmTensor": 6, "tensor": 9, "sphericalTensor": 1}
REMEDY = "the file is damaged or was not written to its end: write it again, or read another time"


def find(path: Path) -> Path | None:
    """Return the path of the file or of its gzip-compressed version, whichever exists, or None."""
    return next((one for one in (path, path.with_name(path.name + ".gz")) if one.is_file()), None)


class FoamFile:
    """The bytes of a file and a cursor in them: `header` has the entries of FoamFile, `at` is the cursor."""

    def __init__(self, path: Path):
        """Read the file and its header."""
        result = find(path)
        if result is None:
            raise ReadError(path, "there is no such file", "give the folder of a whole OpenFOAM case")
        self.path = result
        self.data = result.read_bytes()
        if result.suffix == ".gz" or self.data[:2] == b"\x1f\x8b":
            try:
                self.data = gzip.decompress(self.data)
            except (OSError, EOFError, zlib.error):
                raise ReadError(result, "the compressed file ends early or is damaged", REMEDY) from None
        header = re.search(rb"FoamFile\s*\{(.*?)\}", self.data[:8192], re.DOTALL)
        if header is None:
            raise ReadError(result, "it has no FoamFile header", "give a case that OpenFOAM wrote")
        # A text may contain semicolons, as arch's does.
        entries = re.findall(r"""(\w+)\s+("[^"\n]*"|[^;]+);""", header[1].decode("latin-1"))
        self.header = {key: value.strip().strip('"') for key, value in entries}
        self.binary = self.header.get("format", "ascii") == "binary"
        self.at = header.end()
        arch = self.header.get("arch", "")
        order = ">" if "MSB" in arch else "<"
        sizes = {"label": "32", "scalar": "64", **dict(re.findall(r"(label|scalar)=(\d+)", arch))}
        if wrong := [f"{key}={bits}" for key, bits in sizes.items() if bits not in ("32", "64")]:
            raise self.fault(f"its header states {wrong[0]}: numbers have 32 or 64 bits")
        self.label = np.dtype(f"{order}i{int(sizes['label']) // 8}")
        self.scalar = np.dtype(f"{order}f{int(sizes['scalar']) // 8}")

    def fault(self, what: str, remedy: str = REMEDY) -> ReadError:
        """Return an error at the cursor."""
        return ReadError(self.path, f"{what} (byte {self.at} of {len(self.data)})", remedy)

    def peek(self) -> bytes:
        """Return the next character that is neither blank nor in a comment; empty at the end of the file."""
        self.at = _BLANK.match(self.data, self.at).end()  # type: ignore[union-attr]
        return self.data[self.at : self.at + 1]

    def expect(self, mark: bytes) -> None:
        """Move past a mark such as b"(" that must come next."""
        if self.peek() != mark:
            raise self.fault(f"expected {mark.decode()!r}, found {self.data[self.at : self.at + 12]!r}")
        self.at += 1

    def word(self) -> str:
        """Return the next word and move past it."""
        self.peek()
        match = _WORD.match(self.data, self.at)
        if match is None:
            raise self.fault(f"expected a word, found {self.data[self.at : self.at + 12]!r}")
        self.at = match.end()
        return match[0].decode("latin-1").strip('"')

    def entries(self, repeated: int = 0) -> Iterator[tuple[str, list]]:
        """Yield the key and the content of each entry of a dictionary; the cursor is at its brace, and moves past it.

        The content is words and, after "nonuniform", the list of numbers; what is in brackets is left out. A list of
        one repeated value has at most as many entries as the file has bytes, or `repeated`.
        """
        self.expect(b"{")
        while self.peek() != b"}":
            yield self.word(), self._entry(repeated)
        self.at += 1

    def _entry(self, repeated: int) -> list:
        content: list[str | np.ndarray] = []
        depth = 0
        while depth or self.peek() != b";":
            mark = self.peek()
            if not mark or (mark == b"}" and depth == 0):
                raise self.fault("an entry is not closed")
            if mark in b"(){};":
                depth += 1 if mark in b"({" else -1 if mark in b")}" else 0
                self.at += 1
                if mark == b"}" and depth == 0 and self.peek() != b";":  # a dictionary ends without a semicolon
                    return content
                continue
            word = self.word()
            if depth == 0:
                content.append(word)
                if word == "nonuniform":
                    content.append(self._nonuniform(repeated))
        self.at += 1
        return content

    def _nonuniform(self, repeated: int) -> np.ndarray:
        following = self.word()
        if following == "0":  # "0()": a patch without faces on this processor of a decomposed case
            return np.empty(0)
        if following.removeprefix("List<").removesuffix(">") not in WIDTH:
            raise self.fault("a list is of no kind that is known")
        return self.numbers(self.scalar, WIDTH[following[5:-1]], repeated).astype(np.float64)

    def count(self, repeated: int = 0) -> int:
        """Return the next word as the length of a list.

        The length is at most the size of the file, or `repeated` for a list of one value, `5{1.2}`.
        """
        word = self.word()
        count = whole_number(word)
        if count is None or count > max(len(self.data), repeated if self.peek() == b"{" else 0):
            raise self.fault(f"a list cannot have {word[:20]!r} entries")
        return count

    def numbers(self, kind: np.dtype, width: int = 1, repeated: int = 0) -> np.ndarray:
        """Return a list of numbers, or of vectors of `width` numbers: shape (n,) or (n, width)."""
        count = self.count(repeated)
        uniform = self.peek() == b"{"
        if count == 0 and self.peek() not in (b"(", b"{"):
            return np.zeros((0,) if width == 1 else (0, width), kind.newbyteorder("="))
        self.expect(b"{" if uniform else b"(")
        size = count * width * kind.itemsize
        if uniform:
            values = np.tile(self._text(rb"\}", kind, width), count)
        elif self.binary and count:
            if self.data[self.at + size : self.at + size + 1] != b")":
                raise self.fault(f"{count} binary entries of {kind.itemsize} bytes do not fit between their brackets")
            values = np.frombuffer(self.data, kind, count * width, self.at)
            self.at += size + 1
        else:
            values = self._text(rb"\)\s*\)" if width > 1 and count else rb"\)", kind, count * width)
        values = values.astype(values.dtype.newbyteorder("="))
        return values if width == 1 else values.reshape(count, width)

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Return a list of faces: the first entry of each, shape (n + 1,), and their points, concatenated."""
        if "Compact" in self.header.get("class", "") and self.binary:
            start, points = self.numbers(self.label), self.numbers(self.label)
            if not (len(start) and start[0] == 0 and start[-1] == len(points) and (np.diff(start) > 2).all()):
                raise self.fault("the list of faces does not agree with itself")
            return start.astype(np.int64), points.astype(np.int64)
        count = self.count()
        self.expect(b"(")
        flat = self._text(rb"\)\s*\)", np.dtype(np.int64)) if count else np.empty(0, np.int64)
        width = int(flat[0]) if len(flat) else 0
        if count and width > 2 and len(flat) == count * (width + 1) and (flat[:: width + 1] == width).all():
            return width * np.arange(count + 1), flat.reshape(count, width + 1)[:, 1:].ravel()
        heads, place = np.zeros(count, np.int64), 0
        for face in range(count):
            if place >= len(flat) or not 3 <= flat[place] <= len(flat) - place - 1:
                raise self.fault(f"face {face} of {count} is cut off or has no three points")
            heads[face] = place
            place += int(flat[place]) + 1
        if place != len(flat):
            raise self.fault(f"there is more than the announced {count} faces")
        return starts_of(flat[heads]), np.delete(flat, heads)

    def _text(self, end: bytes, kind: np.dtype, count: int | None = None) -> np.ndarray:
        """Return the numbers up to a pattern, of which there must be `count`; the cursor moves past the pattern."""
        match = re.compile(end).search(self.data, self.at)
        if match is None:
            raise self.fault("a list is not closed")
        text = self.data[self.at : match.start()].translate(bytes.maketrans(b"()", b"  ")).strip()
        self.at = match.end()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                kind = np.dtype(f"{kind.kind}8")  # all digits of a text, whatever size `arch` states
                values = np.fromstring(text.decode("latin-1"), kind, sep=" ") if text else np.empty(0, kind)
            except (DeprecationWarning, ValueError):
                raise self.fault("a list contains something that is not a number") from None
        if count is not None and len(values) != count:
            raise self.fault(f"a list announces {count} numbers and has {len(values)}")
        return values
