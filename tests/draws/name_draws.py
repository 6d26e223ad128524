"""Random words in files: units, names of arrays, times and lists of series, attributes.

As in input_draws.py: an answer whose numbers are finite, or a refusal in one line. NetCDF files are represented by what
HDF5 reads from them, without the file.
"""

import math
import random
from contextlib import suppress
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.arrays import length_of, plain_name, unit_of_array
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.fractions import species_arrays
from aerokernels.flow.reading.readers.foam_case import times_of, unit_in_words
from aerokernels.flow.reading.readers.tecplot_text import coordinate_columns
from aerokernels.flow.reading.readers.vtk_collections import collection
from aerokernels.inputs.units import DIMENSIONS, in_brackets, quantity
from aerokernels.inputs.units import EXPONENTS as WRITTEN

from .input_draws import NUMBERS as WILD
from .input_draws import Draw
from .refusals import check_refusal
from .sound_files import COLLECTION, FILE_SERIES
from .spoiling import spoilt_text

PARTS = ("kg", "m", "m3", "m^3", "m-3", "m**-3", "mm", "s", "Pa", "hPa", "kPa", "GPa", "K", "degC", "deg", "nm", "lb",
         "ft", "slug", "/", "/", " per ", "^", "-", "3", "9", "(", ")", " ", ".", "·", "²", "⁻", "1", "kilogram",
         "meters", "cubic", "°C", "%", "µ", "[", "]", "{", "}", "<", "V", "W", "rtHz", "sqrt(Hz)", "1e400",
         "1_0", "e", "E5")  # fmt: skip
NAMES = ("x", "Y", "z [mm]", "r", "Points:0", "rho", "Density [kg/m3]", "p", "T [degC]", "Y_O2", "N2",
         "massFraction CO2", "CoordinateX", "time", "é", "", " ", "\x00", "[[[", "x (", "a" * 300,
         "\x1b]0;x\x07", "x\ny")  # fmt: skip


def _soup(draw: random.Random) -> str:
    text = "".join(draw.choice(PARTS) for _ in range(draw.choice((1, 1, 2, 3, 5, 9, 40))))
    return spoilt_text(text, draw).decode("utf-8", "replace") if draw.random() < 0.3 else text


def unit(draw: random.Random, folder: Path) -> bool:
    """A unit given beside an array, in its name, or after a number that a user writes."""
    text = _soup(draw)
    number = draw.choice(("", "1 ", "1e-3", "-0.0 ", "1e400 ", ".5", "1_000", str(draw.choice(WILD)), "٣ "))
    in_brackets(text)
    taken = False
    with suppress(ValueError):
        value = quantity(number + text, draw.choice(DIMENSIONS))
        if not math.isfinite(value):
            raise AssertionError(f"{number + text!r} is {value}")
        taken = True
    try:
        for dimension in WRITTEN:
            name, stated = draw.choice((("a", text), (f"a [{text}]", ""), (text, text)))
            with suppress(ReadError):
                found = unit_of_array("a", name, stated, dimension)
                if not (0.0 < found.factor < math.inf and math.isfinite(found.offset)):
                    raise AssertionError(f"{text!r} is {found}")
                taken = True
        length_of("a", {"x": text, "y [mm]": ""})
    except ReadError as fault:
        check_refusal(fault)
    unit_in_words(text)
    return taken


def names(draw: random.Random, folder: Path) -> bool:
    """Names of arrays: which are coordinates, and which are species."""
    drawn = [draw.choice(NAMES) if draw.random() < 0.6 else _soup(draw) for _ in range(draw.randrange(8))]
    for name in drawn:
        if not plain_name(name).isascii():
            raise AssertionError(f"{name!r} is plainly {plain_name(name)!r}")
    if any(not 0 <= column < len(drawn) for column in coordinate_columns(drawn)[0].values()):
        raise AssertionError("columns that are there")
    given = draw.choice((True, ["O2"], ["N2", "O2"], {"O2": draw.choice(NAMES)}, {"basis": "mole", "N2": "N2"}, ["Xx"]))
    try:
        _, found = species_arrays("a", drawn, given)
    except ValueError as fault:
        return check_refusal(fault)
    if not set(found.values()) <= set(drawn):
        raise AssertionError(f"{found} of {drawn}")
    return True


def index(draw: random.Random, folder: Path) -> bool:
    """A list of the files or times of a series: ParaView's two kinds of list, or the folders of a case."""
    if draw.random() < 0.1:
        case = folder / f"case-{draw.randrange(10)}"
        for name in draw.sample(
            ("0", "0.5", "1e-3", "nan", "inf", "1e400", "-1", "٣", "1_0", "0x1", " 1", "constant"), 3
        ):
            (case / name).mkdir(parents=True, exist_ok=True)
            (case / name / "p").touch()
        found = [value for value, _ in times_of(case)]
        if found != sorted(found) or not np.isfinite(found).all():
            raise AssertionError(f"times {found}")
        return bool(found)
    for name in ("a_0.vtu", "a_1.vtu"):
        (folder / name).touch()
    name, sound = draw.choice((("a.pvd", COLLECTION), ("a.vtu.series", FILE_SERIES)))
    path = folder / name
    path.write_bytes(spoilt_text(sound, draw))
    try:
        entries = collection(path)
    except ValueError as fault:
        return check_refusal(fault)
    inside = all(entry.file.resolve().is_relative_to(folder.resolve()) for entry in entries)
    if not entries or not np.isfinite([entry.time for entry in entries]).all() or not inside:
        raise AssertionError(f"entries {entries}")
    return True


DRAWS: dict[str, Draw] = {
    "unit": unit,
    "names": names,
    "index": index,
}
