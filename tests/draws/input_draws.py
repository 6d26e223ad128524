"""Random inputs for every parser of data from outside: scenes, overrides, instrument data, recorded files.

Each input is built from the structure of its kind and spoilt at one or a few places, so that it passes the first check:
a frame with any header has the right check sum, a scene keeps its tables, a store its schema. A parser must return an
answer whose numbers are finite, or a refusal in one line; anything else is raised as an exception. Files are written to
a folder of the caller's; kinds of files are in file_draws.py.
"""

import copy
import json
import math
import random
import struct
import tomllib
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from cobs import cobs

from aerokernels.hardware.frames import GREATEST_FRAME_LENGTH, DamagedPiece, EchoFrame, FrameDecoder
from aerokernels.hardware.preamble import PreambleError, parse_rigol, parse_tektronix
from aerokernels.hardware.scope import Block, BlockDecoder
from aerokernels.process.opened import OPENED
from aerokernels.scene import Scene, SceneError
from aerokernels.scene.loading import known_keys, shipped_scene_text, shipped_scenes

from .damaged_files import damaged
from .refusals import check_refusal

Draw = Callable[[random.Random, Path], bool]
"""Makes an input and gives it to its parser. Returns whether it was accepted; False for a refusal in words."""

NUMBERS = (0, 1, -1, 2, 1e-300, 1e300, -1e300, 1e-3, 0.5, 905e-9, math.nan, math.inf, -math.inf, 10**30, 2**31, 2**63)
TEXTS = ("", " ", "1", "1 m", "-3 mm", "1e999 m", "nan m", "inf s", "1 furlong", "1 m m", "10 deg", "905 nm", "disc",
         "auto", "none", "tunnel", "static", "mach3", "leading-edge", "\x1b[31m", "a\nb", "\u202e", "é" * 40, "0x10",
         "1_000 m", "٣ m", "½ m", "1,5 m", "$HOME", "~", "../..", "/dev/zero", "mach3\x00", "9" * 5000,
         "[1,2]")  # fmt: skip


def any_value(draw: random.Random, depth: int = 0) -> Any:
    """A random TOML value of any kind."""
    kind = draw.randrange(9 if depth < 2 else 6)
    if kind <= 1:
        return draw.choice(NUMBERS)
    if kind <= 3:
        return draw.choice(TEXTS)
    if kind == 4:
        return draw.random() < 0.5
    if kind == 5:
        return f"{draw.choice(NUMBERS)} {draw.choice(('m', 'mm', 'W', 's', 'deg', 'K', 'V', 'Hz', 'kg/m3', '%', 'x'))}"
    if kind == 6:
        return {draw.choice(("m", "a.b", "source", "")): any_value(draw, depth + 1)}
    return [any_value(draw, depth + 1) for _ in range(draw.randrange(5))]


def toml_text(value: Any) -> str:
    """A value as written in TOML, tables inline."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(name)} = {toml_text(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    return str(value)


def scene(draw: random.Random, folder: Path) -> bool:
    """A shipped scene with some of its keys changed, missing or of another kind, as a file."""
    name = draw.choice(shipped_scenes())
    tables = copy.deepcopy(OPENED.once(("tables", name), lambda: tomllib.loads(shipped_scene_text(name))))
    keys = OPENED.once("keys of scenes", lambda: known_keys(Scene))
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        table, _, leaf = draw.choice(keys).rpartition(".")
        way = draw.randrange(10)
        if way == 0:
            tables.pop(draw.choice((table, leaf)), None)
        elif way == 1:
            tables[table or leaf] = any_value(draw)
        elif way == 2:
            leaf = draw.choice((leaf.upper(), leaf + "s", "x", "center", "__class__", ""))
        inner = tables
        for part in table.split(".") if table else ():
            inner = inner.setdefault(part, {}) if isinstance(inner, dict) else {}
        if isinstance(inner, dict) and way:
            inner[leaf] = any_value(draw)
    text = "\n".join(f"{json.dumps(name)} = {toml_text(value)}" for name, value in tables.items()).encode()
    if draw.random() < 0.2:
        at = draw.randrange(len(text))
        text = text[:at] + draw.choice((b"", b"\xff", b"[", b'"""', b"=", b"\r", b"[[a]]\n", b"#")) + text[at + 1 :]
    path = folder / "scene.toml"
    path.write_bytes(text)
    try:
        Scene.load(path)
    except SceneError as fault:
        return check_refusal(fault)
    return True


def override(draw: random.Random, folder: Path) -> bool:
    """--set KEY=VALUE on a shipped scene."""
    keys = known_keys(Scene)
    changes = {}
    for _ in range(draw.choice((1, 1, 2, 3))):
        key = draw.choice((*keys, "a", "flow", "flow.source.x", ".", "", "flow..x", "\x1b.x", "pupil.center.0"))
        value = any_value(draw)
        changes[key] = toml_text(value) if draw.random() < 0.5 else value
    try:
        Scene.load(draw.choice(("sea-level-mach3", "wind-tunnel-mach3")), changes)
    except SceneError as fault:
        return check_refusal(fault)
    return True


_HEADER = struct.Struct("<2sBBIQIffH")


def _frame(draw: random.Random) -> bytes:
    """An encoded frame with a random header; its check sum is right more often than not."""
    count = draw.choice((0, 1, 7, 40))
    edges = (0, 1, 2**31, 2**32 - 1)
    floats = (1e-3, 0.0, -1.0, math.nan, math.inf, 3e38, 1e-45)
    head = _HEADER.pack(
        draw.choice((b"AE", b"AE", b"AE", b"EA")), draw.choice((1, 1, 1, 0, 255)), draw.randrange(256),
        draw.choice(edges), draw.choice((0, 1, 2**63, 2**64 - 1)), draw.choice(edges), draw.choice(floats),
        draw.choice(floats), draw.choice((count, count, count, 0, 65535)),
    )  # fmt: skip
    body = head + draw.randbytes(2 * count)
    if draw.random() < 0.1:
        body = body[: draw.randrange(len(body))]
    check = zlib.crc32(body) ^ (draw.random() < 0.15)
    return bytes(cobs.encode(body + struct.pack("<I", check)) + b"\x00")


def _spoilt(data: bytes, draw: random.Random) -> bytes:
    for _ in range(draw.randrange(3)):
        data = damaged(data, draw)
    return data


def _in_chunks(make: Callable[[], Any], stream: bytes, draw: random.Random, most: int) -> list[Any]:
    """The pieces that a decoder finds in a stream, however it is cut; at most `most` bytes may be pending."""
    whole, decoder = make(), make()
    expected, pieces = [*whole.feed(stream), *whole.finish()], []
    cuts = sorted(draw.randrange(len(stream) + 1) for _ in range(draw.choice((1, 1, 8))))
    for begin, end in pairwise((0, *cuts, len(stream))):
        pieces += decoder.feed(stream[begin:end])
        if decoder.pending_length > most:
            raise AssertionError(f"{decoder.pending_length} bytes are held back of {stream!r}")
    contents = [
        [getattr(piece, "__dict__", piece) for piece in found] for found in (expected, [*pieces, *decoder.finish()])
    ]
    if repr(contents[0]) != repr(contents[1]):
        raise AssertionError(f"the chunks matter in {stream!r}")
    return expected


def frame(draw: random.Random, folder: Path) -> bool:
    """A few frames of a board, damaged in transmission, in chunks."""
    wire = _spoilt(b"".join(_frame(draw) for _ in range(draw.randrange(1, 4))), draw)
    pieces: list[EchoFrame | DamagedPiece] = _in_chunks(FrameDecoder, wire, draw, GREATEST_FRAME_LENGTH)
    taken = False
    for piece in pieces:
        if isinstance(piece, EchoFrame):
            if not (np.isfinite(piece.voltage).all() and np.isfinite(piece.time).all()):
                raise AssertionError("voltages and times are finite")
            taken = True
        elif not piece.reason.isprintable():
            raise AssertionError(f"a reason for people: {piece.reason!r}")
    if b"".join(piece.raw for piece in pieces) != wire.replace(b"\x00", b""):
        raise AssertionError("every byte is in a piece")
    return taken


def block(draw: random.Random, folder: Path) -> bool:
    """Texts and blocks of an oscilloscope, damaged in transmission."""
    parts = (b":CURVE #240" + draw.randbytes(40) + b"\n", b"#15\n#19\n\n", b"#0abc\n", b"12\r\n", b'A "#1',
             b"#9999999999", b':WFMOUTPRE:WFID "Ch1; #1";YMULT 1.0E-3\n')  # fmt: skip
    stream = _spoilt(b"".join(draw.choice(parts) for _ in range(draw.randrange(1, 6))), draw)
    pieces = _in_chunks(lambda: BlockDecoder(4096), stream, draw, 3 * 4096)
    for piece in pieces:
        if isinstance(piece, str) and not piece.replace("\t", " ").isprintable():
            raise AssertionError(f"a text: {piece!r}")
    return any(isinstance(piece, Block) for piece in pieces)


def preamble(draw: random.Random, folder: Path) -> bool:
    """A preamble of an oscilloscope with random numbers, and the curve after it."""
    number = [str(draw.choice((*NUMBERS, 1, 1, 8, 1e-9, "", "x", "1;2", "٣"))) for _ in range(13)]
    try:
        if draw.random() < 0.5:
            names = ("BYT_NR", "BIT_NR", "ENCDG", "BN_FMT", "BYT_OR", "NR_PT", "PT_FMT", "PT_OFF", "XINCR", "XZERO",
                     "YMULT", "YOFF", "YZERO")  # fmt: skip
            words = {"ENCDG": "BINARY", "BN_FMT": draw.choice(("RI", "RP", "FP")),
                     "BYT_OR": draw.choice(("MSB", "LSB")), "PT_FMT": "Y"}  # fmt: skip
            usual = {"BYT_NR": "1", "NR_PT": "8", "XINCR": "1e-9", "YMULT": "1e-3"}
            fields = [f"{name} {words.get(name) or draw.choice((usual.get(name, '0'), value))}"
                      for name, value in zip(names, number, strict=True) if draw.random() < 0.9]  # fmt: skip
            found = parse_tektronix(":WFMOUTPRE:" + ";".join(fields))
        else:
            usual_rigol = ("0", "0", "8", "1", "1e-9", "0", "0", "1e-3", "0", "127")
            values = [draw.choice((plain, plain, value)) for plain, value in zip(usual_rigol, number, strict=False)]
            found = parse_rigol(",".join(values[: draw.choice((10, 10, 10, 9))]))
        curve = found.curve(draw.randbytes(draw.choice((8, 8, 16, 7, 0))), b"", 1)
    except PreambleError as fault:
        return check_refusal(fault)
    if not (np.isfinite(curve.voltage).all() and np.isfinite(curve.time).all()):
        raise AssertionError(f"voltages and times are finite: {found}")
    return True


DRAWS: dict[str, Draw] = {
    "scene": scene,
    "override": override,
    "frame": frame,
    "block": block,
    "preamble": preamble,
}
