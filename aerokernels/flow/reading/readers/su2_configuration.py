"""What the configurations beside an SU2 restart state of the flow, and neither mesh nor restart does.

REF_DIMENSIONALIZATION= FREESTREAM_... makes every density a multiple of the free stream's. SU2 computes that from
FREESTREAM_PRESSURE and FREESTREAM_TEMPERATURE by the ideal gas law, or takes FREESTREAM_DENSITY where FREESTREAM_OPTION
says so; a viscous run takes it from the Reynolds number unless INIT_OPTION is TD_CONDITIONS.

Reference: SU2's configuration template, config_template.cfg.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path

from aerokernels.process.foreign_files import OwnFilesError, own_file

MOST_CONFIGURATIONS, LONGEST_CONFIGURATION = 20, 1_000_000  # files, characters
GAS_CONSTANT = 287.058  # [J/(kg K)] SU2's of air
IDEAL = ("STANDARD_AIR", "IDEAL_GAS")
_STATED = re.compile(r"^[ \t]*(\w{1,60})[ \t]*=[ \t]*([^\s%,]{1,60})", re.MULTILINE)


def configured(folder: Path) -> tuple[list[str], str, str]:
    """Return notes on what the configurations in a folder state.

    The second value is the note on numbers whose unit nothing states, or empty; the third the unit of density, or
    empty.
    """
    notes, scales = [], []
    for path in sorted(folder.glob("*.cfg"))[:MOST_CONFIGURATIONS]:
        try:
            with own_file(folder, path.name).open("r", encoding="latin-1") as stream:
                text = stream.read(LONGEST_CONFIGURATION)
        except (OSError, OwnFilesError):
            continue
        stated = {key.upper(): value.upper() for key, value in _STATED.findall(text)}
        if stated.get("AXISYMMETRIC") == "YES":
            notes.append(f"{path.name} states AXISYMMETRIC= YES: geometry='axisymmetric' reads y as the radius")
        if (scale := stated.get("REF_DIMENSIONALIZATION")) is not None:
            scales.append((path.name, scale, _free_stream(stated) if scale.startswith("FREESTREAM") else 1.0))
    references = {reference for _, _, reference in scales}
    name, scale, reference = next((one for one in scales if one[1].startswith("FREESTREAM")), ("", "", 1.0))
    if not scale:
        return notes, "", ""
    if len(references) == 1 and reference is not None:
        notes.append(f"{name} states {scale}: densities are multiples of its free stream's, {reference:.6g} kg/m3")
        return notes, "", f"{reference!r} kg/m3"
    scaled = f"{name} states {scale}: the density is one of numbers without a unit, give its reference"
    return [*notes, scaled], scaled, ""


def _free_stream(stated: Mapping[str, str]) -> float | None:
    """Return the density of the free stream [kg/m3]; None where a configuration does not give it directly."""
    viscous = stated.get("SOLVER", stated.get("PHYSICAL_PROBLEM", "EULER")).endswith(("NAVIER_STOKES", "RANS"))
    start = stated.get("INIT_OPTION", "REYNOLDS" if viscous else "TD_CONDITIONS")
    model = stated.get("FLUID_MODEL", IDEAL[0])
    if start != "TD_CONDITIONS" or model not in IDEAL or stated.get("SYSTEM_MEASUREMENTS", "SI") != "SI":
        return None
    by_density = stated.get("FREESTREAM_OPTION", "TEMPERATURE_FS") == "DENSITY_FS"
    try:
        if by_density:
            found = float(stated["FREESTREAM_DENSITY"])
        else:
            constant = float(stated.get("GAS_CONSTANT", GAS_CONSTANT)) if model == "IDEAL_GAS" else GAS_CONSTANT
            found = float(stated["FREESTREAM_PRESSURE"]) / (constant * float(stated["FREESTREAM_TEMPERATURE"]))
    except (KeyError, ValueError, ZeroDivisionError):
        return None
    return found if math.isfinite(found) and found > 0.0 else None
