"""The decoder of text lines and IEEE 488.2 blocks: the count alone ends a block, and nothing makes it fail or swell."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerokernels.hardware.frames import DamagedPiece
from aerokernels.hardware.scope import GREATEST_TEXT_LENGTH, Block, BlockDecoder

# Every byte value, and among them what would end a response or begin another one.
DATA = bytes(range(256)) + b"\n\r\n#15\n#0\x00;"
PREAMBLE = b':WFMOUTPRE:BYT_NR 1;WFID "Ch1; #14 points\t";YMULT 1.0E-3\r\n'
STREAM = (
    b"\n\r\n" + PREAMBLE + b":CURVE #3%d" % len(DATA) + DATA + b"\n" + b"#10\n" + b"#H1F\n" + b"12 #x\n"
    b"\x80\xff no text\n" + b"#9000000003\x00\n\x01\n" + b"last line\n" + b"#15ab"
)  # fmt: skip
FOUND = [
    PREAMBLE.decode().strip(),
    Block(DATA, b":CURVE #3%d" % len(DATA) + DATA),
    Block(b"", b"#10"),
    "#H1F",
    "12 #x",
    DamagedPiece(b"\x80\xff no text", "text: bytes that are no ASCII characters"),
    Block(b"\x00\n\x01", b"#9000000003\x00\n\x01"),
    "last line",
    DamagedPiece(b"#15ab", "cut off: here"),
]


def decoded(*chunks: bytes, greatest: int = 1000) -> list:
    decoder = BlockDecoder(greatest)
    found = [one for chunk in chunks for one in decoder.feed(chunk)]
    assert decoder.pending_length <= greatest + 2 * GREATEST_TEXT_LENGTH
    return found + decoder.finish("cut off: here")


def test_split_at_every_byte_position():
    """Cut in two at every position, and byte by byte: one and the same outcome."""
    assert decoded(STREAM) == FOUND
    for cut in range(len(STREAM) + 1):
        assert decoded(STREAM[:cut], STREAM[cut:]) == FOUND, f"cut at {cut}"
    assert decoded(*(STREAM[k : k + 1] for k in range(len(STREAM)))) == FOUND


@pytest.mark.parametrize("count", [1001, 99_999, 999_999_999])
def test_a_block_beyond_the_bound_is_refused_by_its_header(count: int):
    """Nothing is waited for, and the decoder finds its way back at the next line end."""
    digits = str(count).encode()
    found = decoded(b"#%d%s" % (len(digits), digits) + b"\x01\x02\nnext\n")
    assert isinstance(found[0], DamagedPiece) and str(count) in found[0].reason
    assert found[1:] == [DamagedPiece(b"\x01\x02", "text: bytes that are no ASCII characters"), "next"]


def test_text_without_end_does_not_fill_the_memory():
    """Ten longest texts without a line end, in chunks of three sizes: pieces of bounded length, then a line is read."""
    noise = b"U" * (10 * GREATEST_TEXT_LENGTH + 7)
    stream = noise + b"\nnext\n"
    for size in (1, 1021, len(stream)):
        decoder, found = BlockDecoder(), []
        for start in range(0, len(stream), size):
            found += decoder.feed(stream[start : start + size])
            assert decoder.pending_length <= GREATEST_TEXT_LENGTH
        assert [len(one.raw) for one in found[:-2]] == [GREATEST_TEXT_LENGTH] * 10
        assert found[-2:] == ["U" * 7, "next"]


noise = st.binary(max_size=80) | st.sampled_from([b"#", b"#1", b"#9", b"#0", b'"', b"\n", b"#18", b";", b":CURVE "])


@given(st.lists(noise, max_size=12), st.data())
def test_noise_in_any_chunks_gives_one_outcome(parts: list[bytes], data: st.DataObject):
    """Arbitrary bytes, rich in what the grammar is made of: nothing raised, bounded, whatever the chunks."""
    stream = b"".join(parts)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    edges = [0, *cuts, len(stream)]
    chunks = [stream[a:b] for a, b in itertools.pairwise(edges)]
    assert decoded(*chunks, greatest=50) == decoded(stream, greatest=50)
