"""An incremental decoder of frames v1: it turns chunks of bytes into good frames and damaged pieces."""

from dataclasses import dataclass, field

from aerokernels.hardware.frames import DELIMITER, GREATEST_FRAME_LENGTH, EchoFrame, FrameError, decode

_OVERLONG = "length: no delimiter within the longest possible frame"


@dataclass(frozen=True)
class DamagedPiece:
    """Received bytes between two delimiters that are not a good frame, and the reason."""

    raw: bytes = field(repr=False)
    reason: str


class FrameDecoder:
    """Turns a stream of bytes, in chunks of any size, into good frames and damaged pieces.

    The result does not depend on how the bytes are cut into chunks. The decoder buffers at most `GREATEST_FRAME_LENGTH`
    bytes: a longer run without a delimiter becomes damaged pieces of that length.
    """

    def __init__(self) -> None:
        """Start between two frames."""
        self._pending = bytearray()
        self._overlong = False

    @property
    def pending_length(self) -> int:
        """Number of buffered bytes that wait for their delimiter."""
        return len(self._pending)

    def feed(self, chunk: bytes) -> list[EchoFrame | DamagedPiece]:
        """Take the next bytes; return the frames and damaged pieces that they complete, in order."""
        found: list[EchoFrame | DamagedPiece] = []
        *ended, rest = bytes(chunk).split(DELIMITER)
        for piece in ended:
            self._extend(piece, found)
            if self._overlong:
                found.extend(self._damaged(_OVERLONG))
            elif self._pending:
                found.append(self._judge())
            self._pending.clear()
            self._overlong = False
        self._extend(rest, found)
        return found

    def finish(self, reason: str = "cut off: the stream ended before its delimiter") -> list[DamagedPiece]:
        """End the stream: return the pending bytes as a damaged piece, and reset the decoder."""
        found = self._damaged(_OVERLONG if self._overlong else reason)
        self._pending.clear()
        self._overlong = False
        return found

    def _extend(self, piece: bytes, found: list[EchoFrame | DamagedPiece]) -> None:
        start = 0
        while len(self._pending) + len(piece) - start > GREATEST_FRAME_LENGTH:
            room = GREATEST_FRAME_LENGTH - len(self._pending)
            self._pending += piece[start : start + room]
            start += room
            found.extend(self._damaged(_OVERLONG))
            self._pending.clear()
            self._overlong = True
        self._pending += piece[start:]

    def _damaged(self, reason: str) -> list[DamagedPiece]:
        return [DamagedPiece(bytes(self._pending), reason)] if self._pending else []

    def _judge(self) -> EchoFrame | DamagedPiece:
        raw = bytes(self._pending)
        try:
            return decode(raw)
        except FrameError as error:
            return DamagedPiece(raw, str(error))
