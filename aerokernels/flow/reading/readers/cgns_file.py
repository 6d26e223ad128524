"""Read CGNS files with VTK's reader: structured and unstructured zones, solutions at vertices or cell centres.

Runs in the child process of fragile.py.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import Block, Dataset, ReadError
from aerokernels.flow.reading.readers.cgns_counts import check_cells, check_counts
from aerokernels.flow.reading.readers.cgns_statements import statements
from aerokernels.flow.reading.readers.cgns_units import conversions, units
from aerokernels.flow.reading.readers.cgns_walls import patches
from aerokernels.flow.reading.readers.vtk_files import blocks_of
from aerokernels.flow.reading.readers.vtk_running import DAMAGED, run


def read(path: Path, time: Any = None, options: dict | None = None) -> Dataset:
    """Read a CGNS file.

    Raises:
        ReadError: An error that VTK reports, or a file without flow.
    """
    from vtkmodules.vtkIOCGNSReader import vtkCGNSReader

    counts = check_counts(path)
    reader = vtkCGNSReader()
    reader.SetFileName(str(path))
    if not reader.CanReadFile(str(path)):
        raise ReadError(path, "it is not a CGNS file, or it is incomplete", DAMAGED)
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.EnableAllPointArrays()
    reader.EnableAllCellArrays()
    reader.SetDoublePrecisionMesh(1)
    reader.SetLoadBndPatch(False)
    data, times, chosen = run(path, reader, time)
    if times == [0.0]:  # which VTK reports for a file without times
        times, chosen = [], None
    told: dict[str, None] = {}
    blocks = [block for block in blocks_of(path, data, told) if block.cell_count]
    if not blocks:
        raise ReadError(path, "it has no zone with cells", DAMAGED)
    names = [block.name for block in blocks]
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if reader.GetNumberOfBaseArrays() > 1 and twice is not None:
        fault = f"{reader.GetNumberOfBaseArrays()} of its bases contain a zone {twice!r}: moments or cases of one flow"
        raise ReadError(path, fault, "write each base to a file of its own")
    blocks = [replace(block, name=block.name or f"zone {k}") for k, block in enumerate(blocks, start=1)]
    check_cells(path, blocks, counts)
    converted = conversions(path)
    blocks = [_dimensional(block, converted) for block in blocks]
    found, notes = patches(path)
    length, stated = units(path)
    axis, more, scaled = statements(path)
    geometry = None if axis is None else "axisymmetric"
    return Dataset(blocks, "CGNS", geometry, patches=found, times=times, time=chosen, axis=axis, units=stated,
                   length=length, notes=[*told, *notes, *more], scaled=scaled)  # fmt: skip


def _dimensional(block: Block, conversions: Mapping[tuple[str, str], tuple[float, float]]) -> Block:
    """Return a zone with its normalised arrays and coordinates converted as the file says."""

    def made(name: str, values: np.ndarray) -> np.ndarray:
        scale, offset = conversions.get((block.name, name), (1.0, 0.0))
        return values if (scale, offset) == (1.0, 0.0) else scale * values + offset

    if not any(zone == block.name for zone, _ in conversions):
        return block
    points = np.stack([made(f"Coordinate{axis}", block.points[:, k]) for k, axis in enumerate("XYZ")], axis=1)
    point_data, cell_data = (
        {n: made(n, own) for n, own in arrays.items()} for arrays in (block.point_data, block.cell_data)
    )
    return replace(block, points=points, point_data=point_data, cell_data=cell_data)
