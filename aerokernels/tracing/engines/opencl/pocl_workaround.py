"""PoCL 3.0 on processors that its compiler, or its library of built-in functions, has another name for.

pip's PoCL is version 3.0 with LLVM 14. Where that does not know the processor (AMD's from family 26 on), PoCL calls it
"generic", a name that its own compiler refuses, so that nothing at all builds; no option or variable of that version
gives another one (later versions have POCL_LLVM_CPU_NAME). The name is a string that PoCL's record of the device points
to, so it is exchanged there, before anything is built, for a processor of which this one has everything. Nothing is
touched unless the version is that one, on 64-bit Linux on x86, and the word found points to exactly that string.

Where LLVM 14 does know the processor, by a name that the library was not compiled for ("icelake-client"), everything
builds, but no built-in function is inlined: every load of four numbers is a call. The name is exchanged there too.

AEROKERNELS_POCL_CPU gives another name that LLVM 14 knows ("znver3"), or "off" to leave PoCL alone.
"""

import ctypes
import os
import platform
import re
import sys

VARIABLE = "AEROKERNELS_POCL_CPU"
RECORD_WORDS = 256  # words of a device's record that are looked through; the name is near word 80

# Processors that PoCL's own library of built-in functions is compiled for, and which instructions a compiler would use
# on them unasked, by the names in /proc/cpuinfo. A name of the library's own is worth much: functions compiled for a
# processor with more than the kernel's are not inlined, every sqrt() and dot() is a call then (1.6 times slower).
PROCESSORS = (
    ("skylake-avx512", "avx512f avx512bw avx512cd avx512dq avx512vl"),
    ("haswell", "avx avx2 bmi1 bmi2 f16c fma abm movbe"),
    ("x86-64-v2", "cx16 lahf_lm popcnt ssse3 sse4_1 sse4_2"),
)

OF_LIBRARY = tuple(name for name, _ in PROCESSORS)
# What PoCL calls a processor that LLVM does not know.
UNKNOWN = "generic"


def name_processor(device) -> tuple[str, ...]:
    """Name the processor as this PoCL's library does; the compile options that keep its cache apart by that name.

    Safe to call again: what was named is not "generic" any more, and the options stay the same.
    """
    given = _given_name(device)
    name = os.environ.get(VARIABLE) or processor_name()
    if not given or name == "off" or not re.fullmatch(r"[\w.-]{1,40}", name):
        return ()
    if given != UNKNOWN and name not in OF_LIBRARY:
        return ()
    old = given.encode() + b"\0"
    readable = _readable_ranges()
    start = device.int_ptr
    for address in range(start, start + 8 * RECORD_WORDS, 8):
        if not _within(address, 8, readable):
            return ()
        word = ctypes.c_uint64.from_address(address)
        if _within(word.value, len(old), readable) and ctypes.string_at(word.value, len(old)) == old:
            libc = ctypes.CDLL(None)
            libc.strdup.restype = ctypes.c_void_p
            word.value = libc.strdup(name.encode())  # PoCL keeps the pointer for the process's life
            break
    # PoCL's cache goes by source, options and the name given: the other name makes it one of this kind of processor.
    return ("-DPROCESSOR_" + re.sub(r"\W", "_", name),)


def workaround(device, options: tuple[str, ...]) -> str:
    """What `name_processor` did to a device, by the options that it gave, in words; empty where nothing is amiss."""
    given = _given_name(device)
    asked = os.environ.get(VARIABLE)
    if not given or (given != UNKNOWN and not options):
        return ""
    if given != UNKNOWN:
        return (
            f"PoCL 3.0 inlines its functions on no {given!r}: it is told of {asked or processor_name()!r} before "
            f"anything is compiled; {VARIABLE}=off leaves PoCL alone, {VARIABLE}=NAME tells it of another one"
        )
    if options:
        return (
            f"PoCL 3.0 does not know this processor: it is told of {asked or processor_name()!r} before anything is "
            f"compiled; {VARIABLE}=off leaves PoCL alone, {VARIABLE}=NAME tells it of another one"
        )
    why = f"{VARIABLE} is {asked!r}; unset it" if asked else "its record of the device is another one than expected"
    return f"PoCL 3.0 does not know this processor, and it is left alone: {why}"


def processor_name() -> str:
    """The best of PROCESSORS that this one can do, as LLVM names it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as text:
            flags = next((set(line.split(":", 1)[1].split()) for line in text if line.startswith("flags")), set())
    except OSError:
        flags = set()
    for index, (name, _) in enumerate(PROCESSORS):
        if all(set(needed.split()) <= flags for _, needed in PROCESSORS[index:]):
            return name
    return "x86-64"


def _given_name(device) -> str:
    """What PoCL 3.0 calls the processor, where it may better be called otherwise; empty elsewhere."""
    if not (sys.platform == "linux" and platform.machine() == "x86_64" and "PoCL 3.0" in device.platform.version):
        return ""
    name: str = device.version.rpartition("x86_64-unknown-linux-gnu-")[2].strip()
    return "" if name == device.version.strip() or name in OF_LIBRARY else name


def _readable_ranges() -> list[tuple[int, int]]:
    ranges = []
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as text:
        for line in text:
            span, rights = line.split()[:2]
            if rights.startswith("rw"):
                low, high = (int(end, 16) for end in span.split("-"))
                ranges.append((low, high))
    return ranges


def _within(address: int, size: int, ranges: list[tuple[int, int]]) -> bool:
    return any(low <= address and address + size <= high for low, high in ranges)
