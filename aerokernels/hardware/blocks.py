"""An incremental decoder of an oscilloscope's serial output: lines of text and IEEE 488.2 blocks.

A definite-length block is `#`, one digit d (1 to 9), d digits that give a count, and then that many bytes of any value:

    :CURVE #42500<2500 bytes><line feed>

Only the count determines where the block ends: a line feed among the data is data. Text ends with a line feed.

Reference: IEEE Std 488.2-1992, 8.7.9 (definite length arbitrary block response data).
"""

import re
from dataclasses import dataclass, field

from aerokernels.hardware.decoder import DamagedPiece

# Greatest count of bytes accepted; a damaged count must not make the decoder wait for gigabytes.
GREATEST_BLOCK_LENGTH = 32 * 2**20
# Greatest length of a line of text [bytes]; a preamble has some 300.
GREATEST_TEXT_LENGTH = 4096

_SPECIAL = re.compile(rb'[\n#"]')
_TEXT = re.compile(rb"[\x20-\x7e\t]*")
_RESPONSE_HEADER = re.compile(rb"[\s;]*(:?[A-Za-z][A-Za-z0-9_:]*)?[ \t]*")


@dataclass(frozen=True)
class TextLine:
    """A line of text, without its line end."""

    text: str


@dataclass(frozen=True)
class Block:
    """A definite-length block.

    Attributes:
        data: its content.
        raw: the bytes as received: response header, length and content.
    """

    data: bytes = field(repr=False)
    raw: bytes = field(repr=False)


class BlockDecoder:
    """Turns a stream of bytes, in chunks of any size, into text lines, blocks and damaged pieces.

    The result does not depend on how the bytes are cut into chunks, and the time is linear in their number. The decoder
    buffers at most `greatest_length` + 2 `GREATEST_TEXT_LENGTH` bytes.
    """

    def __init__(self, greatest_length: int = GREATEST_BLOCK_LENGTH) -> None:
        """Start between two responses."""
        self._greatest_length = greatest_length
        self._found: list[TextLine | Block | DamagedPiece] = []
        self._begin()

    def _begin(self) -> None:
        self._pending = bytearray()
        self._hash = -1  # index of `#` in the pending bytes while its digits arrive, else -1
        self._wanted = 0  # bytes of the block that have not arrived yet
        self._data_start = 0
        self._quoted = False
        self._overlong = False

    @property
    def pending_length(self) -> int:
        """Number of buffered bytes of an incomplete line or block."""
        return len(self._pending)

    def feed(self, chunk: bytes) -> list[TextLine | Block | DamagedPiece]:
        """Take the next bytes; return the lines, blocks and damaged pieces that they complete, in order."""
        chunk, position = bytes(chunk), 0
        while position < len(chunk):
            if self._wanted:
                position = self._take_data(chunk, position)
            elif self._hash >= 0:
                position = self._take_length(chunk, position)
            else:
                position = self._take_text(chunk, position)
        found, self._found = self._found, []
        return found

    def finish(self, reason: str = "cut off: the stream ended before its end") -> list[DamagedPiece]:
        """End the stream: return the pending bytes as a damaged piece, and reset the decoder."""
        raw = bytes(self._pending)
        self._begin()
        return [DamagedPiece(raw, reason)] if raw.strip() else []

    def _take_data(self, chunk: bytes, position: int) -> int:
        piece = chunk[position : position + self._wanted]
        self._pending += piece
        self._wanted -= len(piece)
        if not self._wanted:
            self._end_block()
        return position + len(piece)

    def _take_length(self, chunk: bytes, position: int) -> int:
        """Take one byte of `#<digit><digits>`; any other byte makes the `#` a character of a text."""
        byte = chunk[position : position + 1]
        digits = bytes(self._pending[self._hash + 1 :]) + byte
        if not byte.isdigit() or digits[:1] == b"0":
            self._hash = -1
            return position
        self._pending += byte
        if len(digits) == 1 + int(digits[:1]):
            self._wanted, self._data_start = int(digits[1:]), len(self._pending)
            if self._wanted > self._greatest_length:
                self._damaged(
                    bytes(self._pending), f"length: a block of {self._wanted} bytes, more than {self._greatest_length}"
                )
                self._begin()
            elif not self._wanted:
                self._end_block()
        return position + 1

    def _take_text(self, chunk: bytes, position: int) -> int:
        room = GREATEST_TEXT_LENGTH - len(self._pending)
        if room <= 0:
            self._damaged(bytes(self._pending), "length: no line end within the longest text")
            self._pending.clear()
            self._overlong = True
            return position
        special = _SPECIAL.search(chunk, position, position + room)
        if special is None:
            piece = chunk[position : position + room]
            self._pending += piece
            return position + len(piece)
        end = special.start()
        if special[0] == b"\n":
            self._pending += chunk[position:end]
            self._end_text()
        else:
            self._pending += chunk[position : end + 1]
            if special[0] == b'"':
                self._quoted = not self._quoted
            elif not self._quoted:
                self._hash = len(self._pending) - 1
        return end + 1

    def _end_text(self) -> None:
        raw = bytes(self._pending)
        text = raw.strip()
        if self._overlong and raw:
            self._damaged(raw, "length: no line end within the longest text")
        elif not _TEXT.fullmatch(text):
            self._damaged(raw, "text: bytes that are no ASCII characters")
        elif text:
            self._found.append(TextLine(text.decode("ascii")))
        self._begin()

    def _end_block(self) -> None:
        pending, start = bytes(self._pending), 0
        if self._overlong or not _RESPONSE_HEADER.fullmatch(pending, 0, self._hash):
            self._damaged(pending[: self._hash], "text: bytes before a block that are no response header")
            start = self._hash
        self._found.append(Block(pending[self._data_start :], pending[start:]))
        self._begin()

    def _damaged(self, raw: bytes, reason: str) -> None:
        if raw:
            self._found.append(DamagedPiece(raw, reason))
