"""Run VTK's readers: the reader for a file, the times that it states, and the errors that VTK prints."""

import re
from pathlib import Path
from typing import Any

from aerokernels.flow.reading.dataset import HDF5_MAGIC, ReadError, chosen_time

DAMAGED = "the file is damaged or of another version: write it again"
READERS = {
    ".vti": "vtkXMLImageDataReader",
    ".vtr": "vtkXMLRectilinearGridReader",
    ".vts": "vtkXMLStructuredGridReader",
    ".vtu": "vtkXMLUnstructuredGridReader",
    ".vtp": "vtkXMLPolyDataReader",
    ".pvti": "vtkXMLPImageDataReader",
    ".pvtr": "vtkXMLPRectilinearGridReader",
    ".pvts": "vtkXMLPStructuredGridReader",
    ".pvtu": "vtkXMLPUnstructuredGridReader",
    ".vtm": "vtkXMLMultiBlockDataReader",
    ".vtmb": "vtkXMLMultiBlockDataReader",
    ".vtpd": "vtkXMLPartitionedDataSetReader",
    ".vtpc": "vtkXMLPartitionedDataSetCollectionReader",
    ".vth": "vtkXMLUniformGridAMRReader",
    ".vthb": "vtkXMLUniformGridAMRReader",
}


def vtk_output(path: Path, suffix: str, time: Any = None) -> tuple[Any, list[float], float | None]:
    """Return the output of VTK's reader for a suffix, the file's times, and the one that was read."""
    from vtkmodules import vtkIOHDF, vtkIOLegacy, vtkIOXML

    reader: Any
    with path.open("rb") as stream:
        in_hdf5 = stream.read(len(HDF5_MAGIC)) == HDF5_MAGIC
    if in_hdf5:
        reader = vtkIOHDF.vtkHDFReader()
        reader.SetMaximumLevelsToReadByDefaultForAMR(0)  # all
    elif suffix == ".vtk":
        reader = vtkIOLegacy.vtkGenericDataObjectReader()
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
        reader.ReadAllTensorsOn()
        reader.ReadAllFieldsOn()
    else:
        reader = getattr(vtkIOXML, READERS.get(suffix, "vtkXMLGenericDataObjectReader"))()
        if suffix.startswith(".vth"):
            reader.SetMaximumLevelsToReadByDefault(0)
    reader.SetFileName(str(path))
    return run(path, reader, time, several=in_hdf5)


def run(path: Path, reader, time: Any = None, several: bool = True) -> tuple[Any, list[float], float | None]:
    """Run a VTK reader on a file: return its output, the file's times, and the one that was read."""
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    reader.UpdateInformation()
    times = _times(reader)
    if len(times) > 1 and not several:
        what = f"it has {len(times)} times in one file"
        raise ReadError(path, what, "write a file for each, and a list of them (.pvd), or .vtkhdf")
    chosen = chosen_time(path, times, time) if times else None
    if chosen is None:
        reader.Update()
    else:
        reader.UpdateTimeStep(chosen)
    said = re.sub(r" ?\(0x[0-9a-f]+\)", "", " ".join(text_of(window.GetOutput()).split()))
    if "ERR" in said or "rror" in said or reader.GetErrorCode():
        what = said.split("): ", 1)[-1][:200] or f"error {reader.GetErrorCode()}"
        raise ReadError(path, f"VTK cannot read it ({what})", DAMAGED)
    data = reader.GetOutputDataObject(0)
    if data is None:
        raise ReadError(path, "VTK finds nothing in it", DAMAGED)
    return data, times, chosen


def _times(reader) -> list[float]:
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    information, key = reader.GetOutputInformation(0), Pipeline.TIME_STEPS()
    if information is None or not information.Has(key):
        return []
    return sorted({float(information.Get(key, k)) for k in range(information.Length(key))})


def text_of(said: str | bytes | None) -> str:
    """Return a text of VTK as str; VTK returns bytes for texts that are not UTF-8."""
    return said.decode("utf-8", "replace") if isinstance(said, bytes) else said or ""
