"""Spoil small files within their structure: words of texts and numbers of binary files, at one or a few places.

`damaged_files.damage` damages bytes as a broken disk does; these functions keep a file's form, so that it passes the
first check: a word is replaced, a count is off by one or announces billions, a list is cut or repeated.
"""

import random
import re
import struct

ODD_WORDS = (
    "", "0", "1", "2", "3", "-1", "-0", "-0.0", "1e400", "-1e400", "1e-400", "nan", "inf", "-inf", "1e300", "0.5",
    "1D5", "65536", "2147483647", "-2147483648", "4294967296", "1099511627775", "9223372036854775807",
    "18446744073709551616",
    "9" * 400, "9" * 5000, "0x10", "1_0", "1,5", "²", "٣", "½", "é", "\ufeff", "\u2028", "\u202e", "\x00", "\x1b[2J",
    "(", ")", "{", "}", "[", "]", ";", '"', "'", "=", ",", "*", "3*0.5", "4294967296*0.5", "//", "/*", "*/", "#", "%",
    "$x", "(" * 3000, "x", "X", "Y", "rho", "uniform", "nonuniform", "List<scalar>", "\r\n", "\n", "\t", "\x0b",
    " " * 3000,
)  # fmt: skip
_WORD = re.compile(r"\s+|[A-Za-z_][\w.]*|[-+.\d][\w.+-]*|.", re.DOTALL)
WHOLE = (0, 1, -1, 2, 3, 4, 5, 7, 31, 255, 65535, 65536, 2**24, 2**30, 2**31 - 1, -(2**31), -2)
REAL = (0.0, -0.0, 1.0, -1.0, 299.0, 357.0, float("nan"), float("inf"), float("-inf"), 1e300, 1e-300, 3e38, 1e-45)


def spoilt_text(text: str, draw: random.Random) -> bytes:
    """A text with some of its words changed, removed, repeated or moved."""
    words = _WORD.findall(text)
    for _ in range(draw.choice((0, 1, 1, 1, 2, 3, 5))):
        if not words:
            break
        at, way = draw.randrange(len(words)), draw.randrange(10)
        if way <= 2:
            words[at] = draw.choice(ODD_WORDS)
        elif way == 3:
            words.insert(at, draw.choice(ODD_WORDS))
        elif way == 4:  # a whole number is off by one
            numbers = [k for k, word in enumerate(words) if word.isascii() and word.isdigit() and len(word) < 18]
            if numbers:
                at = draw.choice(numbers)
                words[at] = str(int(words[at]) + draw.choice((-1, 1, 1, -2, 1000)))
        elif way == 5:
            del words[at : at + draw.choice((1, 1, 2, 10, 1000))]
        elif way == 6:
            words[at:at] = words[at : at + draw.choice((1, 2, 10, 100))]
        elif way == 7:
            other = draw.randrange(len(words))
            words[at], words[other] = words[other], words[at]
        elif way == 8:
            words[at] = words[draw.randrange(len(words))]
        else:
            words[at] = words[at].upper() if draw.random() < 0.5 else words[at][: draw.randrange(len(words[at]) + 1)]
    whole = "".join(words)
    if (way := draw.randrange(40)) == 0:
        whole = whole.replace("\n", draw.choice(("\r\n", "\r", "\n\n", " ", "\x0b")))
    elif way == 1:
        whole = "\ufeff" + whole
    data = whole.encode("latin-1" if draw.random() < 0.1 else "utf-8", "replace")
    return data[: draw.randrange(len(data) + 1)] if way == 2 else data


def spoilt_numbers(data: bytes, draw: random.Random, order: str = "<") -> bytes:
    """A binary file with some of its numbers changed, or parts removed or repeated; mostly in its first bytes."""
    spoilt = bytearray(data)
    for _ in range(draw.choice((0, 1, 1, 1, 2, 3))):
        reach = len(spoilt) if draw.random() < 0.3 else min(len(spoilt), 320)
        if reach < 8:
            break
        way, at = draw.randrange(9), draw.randrange(reach)
        even = at // 4 * 4
        if way <= 2:
            spoilt[even : even + 4] = struct.pack(f"{order}i", draw.choice(WHOLE))
        elif way == 3 and even + 4 <= len(spoilt):
            (held,) = struct.unpack_from(f"{order}i", spoilt, even)
            near = max(-(2**31), min(2**31 - 1, held + draw.choice((-1, 1, 2))))
            spoilt[even : even + 4] = struct.pack(f"{order}i", near)
        elif way == 4:
            wide = draw.choice("fd")
            value = draw.choice(REAL)
            value = max(-3e38, min(3e38, value)) if wide == "f" and abs(value) < float("inf") else value
            spoilt[even : even + struct.calcsize(wide)] = struct.pack(order + wide, value)
        elif way == 5:
            del spoilt[even : even + draw.choice((1, 4, 8, 400))]
        elif way == 6:
            spoilt[even:even] = spoilt[even : even + draw.choice((4, 8, 40))]
        elif way == 7:
            spoilt[at] = draw.randrange(256)
        else:
            del spoilt[at:]
    return bytes(spoilt)
