"""The echo store: what goes in comes back, once, and foreign files are left alone."""

import sqlite3

import numpy as np
import pytest

from aerokernels.hardware.frames import DamagedPiece, EchoFrame, decode, encode
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.store import DamagedStoreError, EchoStore, StoreError


def received(sequence: int, device_time_us: int, value: int = 0) -> EchoFrame:
    frame = EchoFrame(sequence, device_time_us, 1000, 0.001, 0.5, np.array([value, -value, 7]), flags=3)
    return decode(encode(frame)[:-1])


@pytest.fixture
def store(tmp_path):
    with EchoStore(tmp_path / "echoes.sqlite") as store:
        store.begin_recording("/dev/test", "frames", {"mach": "3", "day": "ä"})
        yield store


def test_an_echo_comes_back_as_it_was(store: EchoStore):
    frame = received(2**32 - 1, 2**64 - 1, 1234)
    assert store.add(frame, 42)
    store.add_damaged(DamagedPiece(b"\x01\x02", "CRC: does not match"), 43)
    store.commit()
    with EchoStore(store.path, read_only=True) as reader:  # while the writer has it open
        (echo,) = reader.echoes()
        assert (echo.session, echo.host_time_ns, echo.label) == (1, 42, {"mach": "3", "day": "ä"})
        for name in ("sequence", "device_time_us", "sample_period_ps", "scale", "offset", "flags", "raw", "crc"):
            assert getattr(echo.frame, name) == getattr(frame, name), name
        np.testing.assert_array_equal(echo.frame.voltage, frame.voltage)
        assert (reader.echo_count, reader.damaged_count) == (1, 1)
        assert reader.labels() == [{"day": "ä", "mach": "3"}]
        assert [*reader.echoes({"day": "ä", "mach": "3"})] and not [*reader.echoes({"mach": "3"})]
    with sqlite3.connect(store.path) as connection:
        assert connection.execute("SELECT reason, byte_count, raw FROM damaged").fetchall() == [
            ("CRC: does not match", 2, b"\x01\x02")
        ]
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    connection.close()


def test_a_frame_sent_twice_is_stored_once_and_a_restarted_board_is_not_taken_for_that(store: EchoStore):
    """A wrap at 2**32, two frames sent again, and a restart whose first number and clock were seen before."""
    assert store.add(received(0, 0), 0)
    assert store.add(received(2**31 - 5, 10), 0) and store.add(received(2**32 - 7, 20), 0)
    assert store.add(received(2**32 - 1, 25), 0) and store.add(received(0, 30), 0)  # wrapped
    assert not store.add(received(2**32 - 1, 25), 0) and not store.add(received(0, 30), 0)
    assert store.add(received(1, 40), 0)
    assert store.add(received(0, 0, value=5), 0)  # the board started again
    assert store.add(received(4, 80), 0)
    store.commit()
    assert [(echo.session, echo.frame.sequence) for echo in store.echoes()] == [
        (1, 0), (1, 2**31 - 5), (1, 2**32 - 7), (1, 2**32 - 1), (1, 0), (1, 1), (2, 0), (2, 4),
    ]  # fmt: skip
    with sqlite3.connect(store.path) as connection:
        gaps = connection.execute("SELECT session, after_sequence, before_sequence, missing_count FROM gaps").fetchall()
    connection.close()
    assert gaps == [
        (1, 0, 2**31 - 5, 2**31 - 6),
        (1, 2**31 - 5, 2**32 - 7, 2**31 - 3),
        (1, 2**32 - 7, 2**32 - 1, 5),
        (2, 0, 4, 3),
    ]


def test_a_restarted_recorder_goes_on(store: EchoStore):
    store.add(received(5, 50), 0)
    store.commit()
    store.add(received(6, 60), 0)
    store.close()  # without a commit: frame 6 was never acknowledged
    with EchoStore(store.path) as again:
        again.begin_recording("/dev/test", "frames", {})
        assert not again.add(received(5, 50), 0)
        assert again.add(received(6, 60), 0) and again.add(received(7, 70), 0)
        again.commit()
        assert [(echo.session, echo.frame.sequence) for echo in again.echoes()] == [(1, 5), (1, 6), (1, 7)]


def test_foreign_files_are_refused_and_left_alone(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("not a data base, but long enough to be looked at as one " * 40)
    before = text.read_bytes()
    with pytest.raises(ValueError, match=r"notes\.txt.*give an echo store"):
        EchoStore(text)
    assert text.read_bytes() == before

    other = tmp_path / "other.sqlite"
    connection = sqlite3.connect(other)
    connection.execute("CREATE TABLE mine (x)")
    connection.commit()
    connection.close()
    before = other.read_bytes()
    with pytest.raises(ValueError, match="not an echo store"):
        EchoStore(other)
    assert other.read_bytes() == before

    with EchoStore(tmp_path / "new.sqlite"):
        pass
    connection = sqlite3.connect(tmp_path / "new.sqlite")
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(ValueError, match="schema version 99"):
        EchoStore(tmp_path / "new.sqlite")
    with pytest.raises(ValueError, match="does not exist"):
        EchoStore(tmp_path / "no" / "such.sqlite")
    with pytest.raises(ValueError, match="not a file"):
        EchoStore(tmp_path)
    with pytest.raises(ValueError, match="no such file"):
        EchoStore(tmp_path / "absent.sqlite", read_only=True)
    assert not (tmp_path / "absent.sqlite").exists()


def test_damage_within_the_file_is_told_by_name(tmp_path):
    """Every page but those of the schema is overwritten: reading and writing both name the file and say what to do."""
    path = tmp_path / "s.sqlite"
    with EchoStore(path) as store:
        store.begin_recording("p", "frames", {})
        for k in range(2000):
            store.add(received(k, k), 0)
        store.commit()
    content = bytearray(path.read_bytes())
    content[40_960:] = bytes((7 * byte + k) & 255 for k, byte in enumerate(content[40_960:]))
    path.write_bytes(content)
    with EchoStore(path, read_only=True) as store:
        for read in (store.echoes, store.labels):
            with pytest.raises(DamagedStoreError, match=r"s\.sqlite.*malformed"):
                list(read())
    with EchoStore(path) as store, pytest.raises(StoreError, match=r"s\.sqlite.*malformed"):
        store.begin_recording("p", "frames", {})
        for k in range(2000):
            store.add(received(k, k, value=1), 0)
        store.commit()


def test_curves_of_an_oscilloscope(tmp_path):
    """No clock, a time axis that starts before the trigger, a period that is no whole number of picoseconds."""
    curve = ScopeCurve(None, 1000.0 / 3.0, 0.01, -1.0, np.array([1, -2], np.int16), -2e-9, "PREAMBLE", b"#12\x01\xfe")
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("/dev/scope", "scpi", {})
        # The same bytes twice are two curves where the instrument does not count: nothing says that they are one.
        assert store.add(curve, 1) and store.add(curve, 2)
        store.commit()
        for number, echo in enumerate(store.echoes()):
            back = echo.frame
            assert isinstance(back, ScopeCurve)
            assert (back.sequence, back.device_time_us, back.preamble, back.raw) == (
                number,
                None,
                "PREAMBLE",
                curve.raw,
            )
            np.testing.assert_array_equal(back.voltage, curve.voltage)
            np.testing.assert_array_equal(back.time, curve.time)


def test_an_acquisition_that_is_still_on_the_screen_is_no_second_row(tmp_path):
    """A stopped oscilloscope is read again after a reconnection and a restart: one row; a new curve is one more."""
    curve = ScopeCurve(7, 250, 0.01, 0.0, np.array([1], np.int16), 0.0, "", b"#11\x01")
    other = ScopeCurve(7, 250, 0.01, 0.0, np.array([2], np.int16), 0.0, "", b"#11\x02")
    for _ in range(2):
        with EchoStore(tmp_path / "s.sqlite") as store:
            store.begin_recording("/dev/scope", "scpi", {})
            store.add(curve, 1)
            assert not store.add(curve, 1)
            store.commit()
            assert store.echo_count == 1
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("/dev/scope", "scpi", {})
        assert store.add(other, 1)  # the count began again and has come to 7 once more
        store.commit()
        assert [echo.session for echo in store.echoes()] == [1, 2]


@pytest.mark.parametrize("commit_each", [False, True])
def test_what_another_recorder_of_the_port_stored_is_not_missing(tmp_path, commit_each: bool):
    """Numbers 0 to 29 over the wrap, 11 and 23 lost: each recorder receives every second or third one."""
    path, first = tmp_path / "s.sqlite", 2**32 - 7
    with EchoStore(path) as one, EchoStore(path) as other, EchoStore(path) as apart:
        for store, port in ((one, "p"), (other, "p"), (apart, "another port")):
            store.begin_recording(port, "frames", {})
        for k in set(range(30)) - {11, 23}:
            store = one if k % 3 == 0 or k % 5 == 0 else other
            assert store.add(received((first + k) % 2**32, 1000 * k), 0)
            if commit_each:
                store.commit()
        assert apart.add(received(first, 10**6), 0) and apart.add(received(first + 3, 2 * 10**6), 0)
        for store in (one, other, apart):
            store.commit()
        lost = [((first + k - 1) % 2**32, (first + k + 1) % 2**32, 1) for k in (11, 23)] + [(first, first + 3, 2)]
        gaps = [(gap.after_sequence, gap.before_sequence, gap.missing_count) for gap in one.gaps()]
        assert sorted(gaps) == sorted(lost)
