"""Read cases of EnSight and Fluent with VTK's readers, whose coordinates are in single precision.

A new format that VTK reads takes an entry in `READERS` and one in formats.py. Runs in the child process of fragile.py.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from aerokernels.flow.reading.dataset import UNFINISHED, Dataset, Patch, ReadError
from aerokernels.flow.reading.readers.vtk_files import run, vtk_dataset
from aerokernels.process.foreign_files import own_file

# Format, module of VTK and reader by the end of the name; the longest end counts.
READERS = {
    ".cas.h5": ("Fluent", "vtkIOFLUENTCFF", "vtkFLUENTCFFReader"),
    ".cas": ("Fluent", "vtkIOGeometry", "vtkFLUENTReader"),
    ".case": ("EnSight", "vtkIOEnSight", "vtkGenericEnSightReader"),
    ".encas": ("EnSight", "vtkIOEnSight", "vtkGenericEnSightReader"),
}


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a case."""
    name, module, reader_name = next(own for end, own in READERS.items() if path.name.lower().endswith(end))
    files(path, options, None)  # refuses those that may not be opened
    reader = getattr(import_module(f"vtkmodules.{module}"), reader_name)()
    if name == "EnSight":
        reader.SetFilePath(str(path.parent))
        reader.SetCaseFileName(path.name)
        reader.ReadAllVariablesOn()
    else:
        reader.SetFileName(str(path))
    data, times, chosen = run(path, reader, time)
    dataset = vtk_dataset(path, data, name)
    blocks, patches = dataset.blocks, dataset.patches
    if name == "Fluent":  # whose zones of faces are blocks too, without values
        blocks = [block for block in blocks if block.cell_data or block.point_data] or blocks
        text = path.read_bytes() if path.suffix.lower() == ".cas" else b""
        # The type of each zone is in the text of a case.
        zones = re.findall(rb"\((?:39|45)\s+\(\d+\s+([\w-]+)\s+([^\s()]+)", text)
        kinds = {own.decode("latin-1"): kind.decode("latin-1") for kind, own in zones}
        patches = [Patch(own.name, kinds.get(own.name, own.kind), own.edges, own.polygons) for own in patches]
    notes = [*dataset.notes, "VTK reads its coordinates in single precision"]
    return replace(dataset, blocks=blocks, patches=patches, times=times, time=chosen, notes=notes)


def files(path: Path, options: Mapping[str, Any], time: float | None) -> list[Path]:
    """Return the files that `read` opens: those that a case of EnSight names, the data beside a case of Fluent."""
    if path.suffix.lower() not in (".case", ".encas"):
        data = own_file(path, re.sub(r"\.cas(?=\.h5$|$)", ".dat", path.name, flags=re.IGNORECASE))
        for file in (path, data):
            if path.suffix.lower() != ".cas" or not file.is_file():
                continue
            with file.open("rb") as stream:
                stream.seek(max(file.stat().st_size - 200, 0))
                if not stream.read().rstrip().endswith(b")"):
                    raise ReadError(file, "its last section is not closed", UNFINISHED)
        return [path, data] if data.is_file() else [path]
    named = [path]
    keys = "model|measured|match|boundary|rigid_body|scalar|vector|tensor|complex|filename"
    lines = re.findall(rf"^[ \t]*(?:{keys})[^:\n]*:(.*)$", path.read_text("latin-1"), re.MULTILINE)
    words = [word.strip('"') for line in lines for word in line.split()]
    for word in words:
        own_file(path, word)
        matching = sorted(path.parent.glob(word)) if "*" in word else [path.parent / word]  # a star is a time's number
        named += [own_file(path, os.path.relpath(file, path.parent)) for file in matching if file.is_file()]
    return list(dict.fromkeys(named))
