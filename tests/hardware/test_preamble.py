"""Preambles of both makers: counts become the volts and seconds that the manuals' formulas give."""

import numpy as np
import pytest

from aerokernels.hardware.preamble import PreambleError, parse_rigol, parse_tektronix

TEKTRONIX = (
    ':WFMOUTPRE:BYT_NR 2;BIT_NR 16;ENCDG BINARY;BN_FMT RI;BYT_OR MSB;WFID "Ch1, DC coupling; 4 points";NR_PT 4;'
    'PT_FMT Y;XUNIT "s";XINCR 2.5000E-10;XZERO 1.0E-9;PT_OFF 2;YUNIT "V";YMULT 31.2500E-6;YOFF -640.0;YZERO 0.5;NR_FR 3'
)
RIGOL = "0,2,5,1,1.000000e-09,-3.000000e-06,1,4.0e-02,-20,127"


def test_tektronix():
    """Volts: YZERO + YMULT (y - YOFF), and seconds: XZERO + XINCR (k - PT_OFF), computed by hand."""
    preamble = parse_tektronix(TEKTRONIX)
    counts = np.array([0, -640, 32767, -32768])
    curve = preamble.curve(counts.astype(">i2").tobytes(), b"raw", 7)
    np.testing.assert_allclose(curve.voltage, 0.5 + 31.25e-6 * (counts + 640.0), rtol=1e-12)
    np.testing.assert_allclose(curve.time, 1e-9 + 0.25e-9 * (np.arange(4) - 2), rtol=1e-12)
    assert (curve.sequence, curve.sample_period_ps, curve.device_time_us, curve.preamble) == (7, 250, None, TEKTRONIX)
    assert abs(curve.peak - curve.voltage.max()) < 1e-12


def test_rigol():
    """Volts: (y - yorigin - yreference) yincrement, and seconds: xorigin + (k - xreference) xincrement, by hand."""
    preamble = parse_rigol(RIGOL)
    counts = np.array([0, 107, 127, 200, 255])
    curve = preamble.curve(counts.astype(np.uint8).tobytes(), b"", None)
    np.testing.assert_allclose(curve.voltage, 0.04 * (counts + 20.0 - 127.0), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(curve.time, -3e-6 + 1e-9 * (np.arange(5) - 1), rtol=1e-12)
    assert parse_rigol(f":WAVEFORM:PREAMBLE {RIGOL}").scale == preamble.scale


@pytest.mark.parametrize("kind", ["RI", "RP"])
@pytest.mark.parametrize("order", ["MSB", "LSB"])
@pytest.mark.parametrize("width", [1, 2])
def test_every_binary_format(kind: str, order: str, width: int):
    """The ends of the range and its middle, for each number format; unsigned 16 bit fit the store's int16 too."""
    code = {"MSB": ">", "LSB": "<"}[order] + {"RI": "i", "RP": "u"}[kind] + str(width)
    limits = np.iinfo(np.dtype(code))
    counts = np.array([limits.min, limits.min // 2, 0, 1, limits.max])
    text = f"BYT_NR {width};BN_FMT {kind};BYT_OR {order};NR_PT 5;XINCR 1E-9;XZERO 0;YMULT 2.0E-3;YOFF 3;YZERO -1"
    curve = parse_tektronix(text).curve(counts.astype(code).tobytes(), b"", 0)
    assert curve.samples.dtype == np.int16
    np.testing.assert_allclose(curve.voltage, -1.0 + 2e-3 * (counts - 3.0), rtol=1e-12, atol=1e-12)


def test_short_names_and_fewest_fields():
    """VERBOSE OFF shortens the names; what an older instrument leaves out has its usual value."""
    short = "BYT_N 1;ENC BIN;BN_F RP;BYT_O LSB;NR_P 3;PT_F Y;XIN 1E-9;XZE 2E-9;YMU 0.1;YOF 1;YZE 0"
    np.testing.assert_allclose(parse_tektronix(short).curve(b"\x01\x02\xff", b"", 0).voltage, [0.0, 0.1, 25.4])
    fewest = parse_tektronix("YMULT 0.5;YOFF 1;YZERO 0;XINCR 1e-9;XZERO 0")
    np.testing.assert_allclose(fewest.curve(b"\x01\xff", b"", 0).voltage, [0.0, -1.0])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "no XINCR and no YMULT"),
        (TEKTRONIX.replace("YMULT", "YMUTL"), "no YMULT"),
        (TEKTRONIX.replace("31.2500E-6", "31.2.5"), "YMULT = '31.2.5'"),
        (TEKTRONIX.replace("31.2500E-6", "9.9E999"), "YMULT"),
        (TEKTRONIX.replace("31.2500E-6", "0.0"), "0.0 V per count"),
        (TEKTRONIX.replace("2.5000E-10", "-1"), "every -1"),
        (TEKTRONIX.replace("ENCDG BINARY", "ENCDG ASCII"), "DATA:ENCDG RIBINARY"),
        (TEKTRONIX.replace("PT_FMT Y", "PT_FMT ENV"), "PT_FMT ENV"),
        (TEKTRONIX.replace("BN_FMT RI", "BN_FMT FP"), "FP"),
        (TEKTRONIX.replace("BYT_NR 2", "BYT_NR 8"), "of 8"),
        (TEKTRONIX.replace("NR_PT 4", "NR_PT 0"), "0 samples"),
        (TEKTRONIX.replace("NR_PT 4", "NR_PT 9e400"), "NR_PT"),
    ],
)
def test_a_tektronix_preamble_that_cannot_be_used(text: str, match: str):
    with pytest.raises(PreambleError, match=match):
        parse_tektronix(text)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("1,2,3", "3 values instead of 10"),
        (RIGOL.replace("0,2,5", "2,2,5", 1), "FORMAT BYTE"),
        (RIGOL.replace("4.0e-02", "nan"), "yincrement"),
        (RIGOL.replace("4.0e-02", "x"), "yincrement = 'x'"),
    ],
)
def test_a_rigol_preamble_that_cannot_be_used(text: str, match: str):
    with pytest.raises(PreambleError, match=match):
        parse_rigol(text)
