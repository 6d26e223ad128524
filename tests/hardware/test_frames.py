"""Frame v1 and its incremental decoder: what is sent comes out, and nothing that was damaged does."""

import struct
import zlib

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from aerokernels.hardware.frames import (
    GREATEST_FRAME_LENGTH,
    DamagedPiece,
    EchoFrame,
    FrameDecoder,
    FrameError,
    decode,
    encode,
)

any_frame = st.builds(
    EchoFrame,
    sequence=st.integers(0, 2**32 - 1),
    device_time_us=st.integers(0, 2**64 - 1),
    sample_period_ps=st.integers(0, 2**32 - 1),
    scale=st.floats(width=32, allow_nan=False, allow_infinity=False),
    offset=st.floats(width=32, allow_nan=False, allow_infinity=False),
    samples=st.lists(st.integers(-32768, 32767), max_size=300).map(lambda counts: np.array(counts, dtype=np.int16)),
    flags=st.integers(0, 255),
)


def contents(frame: EchoFrame) -> tuple:
    return (
        frame.sequence,
        frame.device_time_us,
        frame.sample_period_ps,
        frame.scale,
        frame.offset,
        frame.flags,
        frame.samples.tolist(),
    )


def seen(found: list) -> list:
    """Frames by their content, damaged pieces by their bytes and reason."""
    return [contents(one) if isinstance(one, EchoFrame) else (one.raw, one.reason) for one in found]


def test_the_bytes_are_those_of_the_specification():
    """A frame packed by hand, field by field as the format is written down, COBS as defined for short blocks."""
    body = (
        b"AE" + bytes([1, 0x81])
        + (7).to_bytes(4, "little") + (123_456_789_012).to_bytes(8, "little") + (250).to_bytes(4, "little")
        + struct.pack("<f", 0.5) + struct.pack("<f", -1.25) + (3).to_bytes(2, "little")
        + b"\x01\x00" + b"\xff\xff" + b"\x00\x80"
    )  # fmt: skip
    payload = body + zlib.crc32(body).to_bytes(4, "little")
    blocks = payload.split(b"\x00")
    wire = b"".join(bytes([len(block) + 1]) + block for block in blocks) + b"\x00"
    frame = EchoFrame(7, 123_456_789_012, 250, 0.5, -1.25, np.array([1, -1, -32768]), flags=0x81)
    assert encode(frame) == wire
    assert contents(decode(wire[:-1])) == contents(frame)
    np.testing.assert_array_equal(frame.voltage, [-0.75, -1.75, -16385.25])
    np.testing.assert_allclose(frame.time, [0.0, 250e-12, 500e-12], rtol=1e-15)


@given(any_frame)
def test_decode_undoes_encode(frame: EchoFrame):
    wire = encode(frame)
    assert wire.count(b"\x00") == 1 and wire.endswith(b"\x00") and len(wire) - 1 <= GREATEST_FRAME_LENGTH
    back = decode(wire[:-1])
    assert contents(back) == contents(frame)
    assert back.raw == wire[:-1]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"sequence": 2**32}, "sequence = 4294967296"),
        ({"sequence": -1}, "sequence = -1"),
        ({"device_time_us": 2**64}, "device_time_us"),
        ({"scale": float("nan")}, "scale must be finite, got nan"),
        ({"offset": 1e39}, "offset = 1e"),
        ({"samples": np.array([40000])}, "int16"),
        ({"samples": np.array([0.5])}, "float64"),
        ({"samples": np.zeros((2, 2), np.int16)}, r"\(2, 2\)"),
        ({"samples": np.zeros(65536, np.int16)}, "65535"),
    ],
)
def test_values_without_room_in_a_frame_are_refused(change: dict, match: str):
    whole = {
        "sequence": 0, "device_time_us": 0, "sample_period_ps": 1, "scale": 1.0, "offset": 0.0,
        "samples": np.zeros(1, np.int16),
    }  # fmt: skip
    with pytest.raises(ValueError, match=match):
        EchoFrame(**(whole | change))


def sealed(body: bytes) -> bytes:
    """`body` with a correct CRC and COBS code: wrong in itself, not in transit."""
    return cobs.encode(body + struct.pack("<I", zlib.crc32(body)))


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (b"\x05ab", "COBS"),
        (b"\x01", "length"),
        (sealed(struct.pack("<2sBBIQIffH", b"EA", 1, 0, 0, 0, 1, 1.0, 0.0, 0)), "magic"),
        (sealed(struct.pack("<2sBBIQIffH", b"AE", 2, 0, 0, 0, 1, 1.0, 0.0, 0)), "version: 2"),
        (sealed(struct.pack("<2sBBIQIffH", b"AE", 1, 0, 0, 0, 1, 1.0, 0.0, 4) + bytes(6)), "count of 4"),
        (sealed(struct.pack("<2sBBIQIffH", b"AE", 1, 0, 0, 0, 1, 1.0, 0.0, 2) + bytes(5)), "count of 2"),
        (sealed(struct.pack("<2sBBIQIffH", b"AE", 1, 0, 0, 0, 1, float("nan"), 0.0, 0)), "scale = nan"),
    ],
)
def test_each_kind_of_damage_has_its_reason(raw: bytes, reason: str):
    with pytest.raises(FrameError, match=reason):
        decode(raw)


def test_every_flipped_byte_is_noticed_and_costs_no_more_than_its_neighbour(frames: list[EchoFrame]):
    """Each byte of the middle frame in turn is changed in five ways, 0x00 and a flipped bit among them.

    Expected: no frame comes out that was not sent (CRC-32 finds every burst of up to 32 bits; a change of the COBS code
    changes the length or more bytes, found with a chance of 1 - 2**-32 each), and every other frame does, except that
    a lost delimiter glues the next frame on.
    """
    wire = [encode(frame) for frame in frames[:5]]
    sent = [contents(frame) for frame in frames[:5]]
    start, length = len(wire[0]) + len(wire[1]), len(wire[2])
    stream = b"".join(wire)
    for position in range(start, start + length):
        for mask in (0x01, 0x80, 0xFF, 0x10, stream[position]):
            if mask == 0:
                continue
            changed = bytearray(stream)
            changed[position] ^= mask
            decoder = FrameDecoder()
            found = decoder.feed(bytes(changed)) + decoder.finish()
            good = [contents(one) for one in found if isinstance(one, EchoFrame)]
            lost = {2, 3} if position == start + length - 1 else {2}
            assert good == [one for k, one in enumerate(sent) if k not in lost], (position, mask)
            damaged = [one for one in found if isinstance(one, DamagedPiece)]
            assert damaged and all(one.reason for one in damaged)


@given(st.lists(st.binary(max_size=60), max_size=8), any_frame)
def test_any_garbage_between_delimiters_leaves_frames_alone(garbage: list[bytes], frame: EchoFrame):
    """Arbitrary bytes (delimiters too) in any chunks: nothing raised, bytes conserved, the frame after it good."""
    decoder = FrameDecoder()
    found = [one for chunk in garbage for one in decoder.feed(chunk)]
    found += decoder.feed(b"\x00" + encode(frame))
    assert seen(found)[-1] == contents(frame)
    assert b"".join(one.raw for one in found[:-1]) == b"".join(garbage).replace(b"\x00", b"")
    assert decoder.pending_length == 0


def test_a_stream_without_delimiters_does_not_fill_the_memory(frames: list[EchoFrame]):
    """2.5 greatest lengths of garbage: held bytes stay bounded, all come out as damaged, then a frame is read."""
    garbage = b"\x55" * (5 * GREATEST_FRAME_LENGTH // 2)
    stream = garbage + b"\x00" + encode(frames[3])
    outcomes = []
    for size in (1021, 70_001, len(stream)):
        decoder, found = FrameDecoder(), []
        for start in range(0, len(stream), size):
            found += decoder.feed(stream[start : start + size])
            assert decoder.pending_length <= GREATEST_FRAME_LENGTH
        assert b"".join(one.raw for one in found[:-1]) == garbage
        assert all("delimiter" in one.reason for one in found[:-1])
        outcomes.append(seen(found))
    assert outcomes[0] == outcomes[1] == outcomes[2]
    assert outcomes[0][-1] == contents(frames[3])
