"""Files of EnSight, Fluent and Exodus: the flow of writers.py is read again; others' files in them are refused.

Set-up: EnSight by VTK's writer, Fluent and Exodus by their descriptions. Expected: values to the last bit of what the
file holds (EnSight: single precision), places within single precision of EnSight and Fluent. Truth for Exodus beside:
VTK's own reader.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import writers

from aerokernels import flow

vtk_writers = pytest.importorskip("vtk_writers")
pytest.importorskip("vtkmodules")
X, Y = writers.grid()
RHO, MEANS = writers.rho(X, Y).ravel(), writers.cell_means(writers.rho(X, Y)).ravel()
SECOND = (0.0, 0.5)


def ensight(folder: Path) -> Path:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkIOParallel import vtkEnSightWriter

    data = vtk_writers.vtk_unstructured(vtk_writers.vtk_grid())
    number = numpy_to_vtk(np.ones(data.GetNumberOfCells(), np.int32), deep=True)
    number.SetName("BlockId")
    data.GetCellData().AddArray(number)
    writer = vtkEnSightWriter()
    writer.SetFileName(str(folder / "flow"))
    writer.SetInputData(data)
    writer.Write()
    writer.WriteCaseFile(1)
    return next(folder.glob("*.case")).rename(folder / "flow.case")


def fluent(folder: Path) -> Path:
    """A plane of quadrilaterals: faces between cells, and a wall around them; cells are numbered from 1 on."""
    count = (writers.NI - 1) * (writers.NJ - 1)
    index = 1 + np.arange(X.size).reshape(X.shape)
    cell = np.pad(1 + np.arange(count).reshape(writers.NJ - 1, -1), 1)
    upward = np.stack([index[:-1], index[1:], cell[1:-1, 1:], cell[1:-1, :-1]], axis=-1).reshape(-1, 4)
    along = np.stack([index[:, 1:], index[:, :-1], cell[1:, 1:-1], cell[:-1, 1:-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([upward, along])
    faces = np.where((faces[:, 2] == 0)[:, None], faces[:, [1, 0, 3, 2]], faces)
    inner, outer = faces[faces[:, 3] > 0], faces[faces[:, 3] == 0]

    def section(head: str, rows) -> str:
        return f"{head}(\n" + "\n".join(" ".join(map(str, row)) for row in rows) + "\n))\n"

    def hexadecimal(rows):
        return [[f"{number:x}" for number in row] for row in rows.tolist()]

    points = np.stack([X.ravel(), Y.ravel()], axis=1).tolist()
    text = f'(0 "flow")\n(2 2)\n(10 (0 1 {X.size:x} 0 2))\n(12 (0 1 {count:x} 0 0))\n(13 (0 1 {len(faces):x} 0 0))\n'
    text += section(f"(10 (1 1 {X.size:x} 1 2)", points) + f"(12 (2 1 {count:x} 1 3))\n"
    text += section(f"(13 (3 1 {len(inner):x} 2 2)", hexadecimal(inner))
    text += section(f"(13 (4 {len(inner) + 1:x} {len(faces):x} 3 2)", hexadecimal(outer))
    (folder / "flow.cas").write_text(
        text + "(45 (2 fluid air)())\n(45 (3 interior inside)())\n(45 (4 wall around)())\n"
    )
    (folder / "flow.dat").write_text('(0 "flow")\n' + section(f"(300 (101 2 1 0 0 1 {count})", MEANS[:, None].tolist()))
    return folder / "flow.cas"


def exodus(folder: Path) -> Path:
    from scipy.io import netcdf_file

    cells, nodes = writers.quads(), np.stack([X.ravel(), Y.ravel()])
    with netcdf_file(folder / "flow.e", "w", version=2) as file:
        file.version = file.api_version = np.float32(5.0)
        file.floating_point_word_size, file.file_size, file.title = np.int32(8), np.int32(1), b"flow"
        sizes = {"time_step": None, "len_string": 33, "num_dim": 2, "num_nodes": X.size, "num_elem": len(cells),
                 "num_el_blk": 1, "num_el_in_blk1": len(cells), "num_nod_per_el1": 4, "one": 1}  # fmt: skip
        for name, size in sizes.items():
            file.createDimension(name, size)
        for axis, own in zip("xy", nodes, strict=True):
            file.createVariable(f"coord{axis}", "d", ("num_nodes",))[:] = own
        file.createVariable("eb_status", "i", ("num_el_blk",))[:] = [1]
        number = file.createVariable("eb_prop1", "i", ("num_el_blk",))
        number[:], number.name = [1], b"ID"
        corners = file.createVariable("connect1", "i", ("num_el_in_blk1", "num_nod_per_el1"))
        corners[:], corners.elem_type = cells + 1, b"QUAD4"
        file.createDimension("num_nod_var", 1)
        file.createDimension("num_elem_var", 1)
        for kind, place, name, values in (("nod", "num_nodes", "rho", RHO), ("elem", "num_el_in_blk1", "mean", MEANS)):
            called = file.createVariable(f"name_{kind}_var", "c", (f"num_{kind}_var", "len_string"))
            called[0] = np.frombuffer(name.encode().ljust(33, b"\0"), "S1")
            own = file.createVariable(
                f"vals_{kind}_var1" + ("eb1" if kind == "elem" else ""), "d", ("time_step", place)
            )
            for step, _ in enumerate(SECOND):
                own[step] = (1.0 + step) * values
        clock = file.createVariable("time_whole", "d", ("time_step",))
        for step, time in enumerate(SECOND):
            clock[step] = time
    return folder / "flow.e"


def places(mesh) -> np.ndarray:
    """The x and y of the file, in the order of its points."""
    return np.stack([-mesh.vertices[:, 1], mesh.vertices[:, 0]])


def test_ensight(tmp_path):
    field = flow.read(ensight(tmp_path), density="rho_n")
    assert np.abs(field.density - writers.rho(*places(field.mesh))).max() < 4e-7
    assert "single precision" in field.provenance


def test_fluent(tmp_path):
    field = flow.read(fluent(tmp_path))
    middle = field.mesh.corners.mean(axis=1)
    order = np.lexsort(np.round(middle, 6).T)
    truth = np.stack([Y, -X], axis=-1).reshape(-1, 2)[writers.quads()].mean(axis=1)
    assert np.array_equal(field.density[order], MEANS[np.lexsort(np.round(truth, 6).T)])
    assert np.abs(middle[order] - truth[np.lexsort(np.round(truth, 6).T)]).max() < 1e-8


@pytest.mark.parametrize(("time", "factor"), [("first", 1.0), (0.5, 2.0)])
def test_exodus(tmp_path, time, factor):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOExodus import vtkExodusIIReader

    path = exodus(tmp_path)
    field = flow.read(path, time=time)
    assert np.array_equal(field.density.ravel(), factor * writers.rho(*places(field.mesh)).ravel())
    means = flow.read(path, time=time, density="mean")
    assert np.array_equal(np.sort(means.density.ravel()), np.sort(factor * MEANS))
    assert flow.contents(path).times == SECOND and list(flow.open_series(path).time) == [*SECOND]
    reader = vtkExodusIIReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetPointResultArrayStatus("rho", 1)
    reader.UpdateTimeStep(0.0 if time == "first" else 0.5)
    block = reader.GetOutput().GetBlock(0).GetBlock(0)
    theirs = vtk_to_numpy(block.GetPointData().GetArray("rho"))
    assert np.array_equal(np.sort(field.density.ravel()), np.sort(theirs))


@pytest.mark.parametrize(
    ("make", "name"), [(ensight, "flow.0.00000.geo"), (fluent, "flow.cas"), (fluent, "flow.dat"), (exodus, "flow.e")]
)
def test_files_cut_short_are_refused(tmp_path, make, name, readers_child):
    path = make(tmp_path)
    for share in (0.1, 0.95) if "AEROKERNELS_SLOW" in os.environ else (0.95,):  # a child for each
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: int(share * len(data))])
        with pytest.raises(flow.ReadError, match=path.name.split(".")[0]) as refused:
            flow.read(path, density="rho_n" if make is ensight else None)
        assert "\n" not in str(refused.value)
        (tmp_path / name).write_bytes(data)


def test_a_case_may_not_open_files_of_other_folders(tmp_path):
    (tmp_path / "case").mkdir()
    path = ensight(tmp_path / "case")
    names = {file.name for file in path.parent.iterdir()}
    (tmp_path / "secret.geo").write_bytes(b"")
    text = path.read_text()
    path.write_text(text.replace("flow.0.00000.geo", "../secret.geo"))
    with pytest.raises(flow.ReadError, match=r"names '\.\./secret\.geo', which is outside of its own folder"):
        flow.read(path, density="rho_n")
    from aerokernels.flow.reading.formats import files_behind

    path.write_text(text)
    assert {file.name for file in files_behind(path)} <= names and len(files_behind(path)) >= 3
