"""Damage on the line: what was done to each frame is what the decoder says."""

from aerokernels.hardware.frames import EchoFrame, FrameDecoder
from tests.recording.line import damaged_line, made_frames


def test_twenty_thousand_frames_with_five_per_cent_of_damage():
    """Torn, flipped, glued and garbage pieces, 1.25 % each: counts exact, no damaged piece taken as good.

    Expected, from what was done to each frame: all others come out in order, none of these do; one damaged piece for
    each fault (a glued pair is one piece), and the byte sums agree.
    """
    frames = made_frames(20_000, sample_count=24)
    wire, good, piece_count = damaged_line(frames, 0.0125, seed=5)
    decoder, numbers, damaged = FrameDecoder(), [], 0
    for start in range(0, len(wire), 1021):
        for one in decoder.feed(wire[start : start + 1021]):
            if isinstance(one, EchoFrame):
                assert one.samples.tobytes() == frames[one.sequence].samples.tobytes()
                numbers.append(one.sequence)
            else:
                damaged += 1
    assert decoder.pending_length == 0
    assert numbers == good
    assert damaged == piece_count and 900 < damaged < 1100
