"""CGNS, by VTK's reader: structured and unstructured zones, solutions at vertices or cell centres.

Runs in the child of fragile.py.
"""

from pathlib import Path
from typing import Any

from .cgns_walls import patches
from .dataset import Block, Dataset, ReadError
from .vtk_files import DAMAGED, blocks_of, chosen_time, run


def read(path: Path, time: Any = None, options: dict | None = None) -> Dataset:
    """Read a CGNS file.

    Raises:
        ReadError: Whatever VTK reports, or a file without flow.
    """
    from vtkmodules.vtkIOCGNSReader import vtkCGNSReader

    reader = vtkCGNSReader()
    reader.SetFileName(str(path))
    if not reader.CanReadFile(str(path)):
        raise ReadError(path, "it is no CGNS file, or not a whole one", DAMAGED)
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.EnableAllPointArrays()
    reader.EnableAllCellArrays()
    reader.SetDoublePrecisionMesh(1)
    reader.SetLoadBndPatch(False)
    times = _times(reader)
    chosen = None
    if len(times) > 1 or time not in (None, "latest", "first"):
        if not times:
            raise ReadError(path, f"it holds one time only, not t = {time!r}", "leave time out")
        chosen = chosen_time(path, times, time)
        reader.UpdateTimeStep(chosen)
    data = run(path, reader)
    blocks = [block for block in blocks_of(path, data) if block.cell_count]
    if not blocks:
        raise ReadError(path, "it has no zone with cells", DAMAGED)
    blocks = [_named(block, k) for k, block in enumerate(blocks)]
    found, notes = patches(path)
    return Dataset(blocks, "CGNS", patches=found, times=times if len(times) > 1 else [], time=chosen, notes=notes)


def _named(block: Block, number: int) -> Block:
    from dataclasses import replace

    return replace(block, name=block.name or f"zone {number + 1}")


def _times(reader) -> list[float]:
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    information, key = reader.GetOutputInformation(0), Pipeline.TIME_STEPS()
    return [float(information.Get(key, k)) for k in range(information.Length(key))] if information.Has(key) else []
