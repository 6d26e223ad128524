"""Files that a file names are regular files in its own folder, after resolving links: read there, refused elsewhere."""

import os

import numpy as np
import pytest

from aerokernels import flow

from . import vtk_writers, writers


def vtu(path):
    path.parent.mkdir(exist_ok=True, parents=True)
    return vtk_writers.write_vtk(path, vtk_writers.vtk_unstructured(vtk_writers.vtk_even(three=True)))


def listing(path, name: str):
    """A list of one piece; of other kinds than VTK's parallel files the piece is a block."""
    if path.suffix == ".pvtu":
        path.write_text(
            '<VTKFile type="PUnstructuredGrid" version="1.0"><PUnstructuredGrid GhostLevel="0"><PPointData>'
            '<PDataArray type="Float64" Name="rho"/></PPointData><PPoints><PDataArray type="Float64" Name="Points" '
            f'NumberOfComponents="3"/></PPoints><Piece Source="{name}"/></PUnstructuredGrid></VTKFile>'
        )
    else:
        path.write_text(
            '<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>'
            f'<DataSet index="0" file="{name}"/></vtkMultiBlockDataSet></VTKFile>'
        )
    return path


@pytest.mark.parametrize("end", ["pvtu", "vtm", "vtm in pvd"])
def test_pieces_of_other_folders_and_pipes_are_refused(tmp_path, end: str, monkeypatch):
    """Expected: a piece in a folder below is read; elsewhere, by whatever way, it is refused, and so is a pipe."""
    pytest.importorskip("vtkmodules")
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = tmp_path / "own"
    vtu(tmp_path / "secret.vtu"), vtu(folder / "below/piece.vtu")
    (folder / "behind.vtu").symlink_to(tmp_path / "secret.vtu")
    os.mkfifo(folder / "pipe.vtu")
    list_of = listing(folder / f"a.{end.split()[0]}", "below/piece.vtu")
    path = list_of
    if " " in end:
        path = folder / "a.pvd"
        path.write_text('<VTKFile type="Collection"><Collection><DataSet file="a.vtm"/></Collection></VTKFile>')
    x, y = 0.003 * np.arange(writers.NI), 0.01 + 0.002 * np.arange(writers.NJ)
    at = np.array([[x[3], y[4], 0.02], [x[20], y[11], 0.03]])
    density = [writers.rho(x[3], y[4]) + 0.02, writers.rho(x[20], y[11]) + 0.03]
    assert flow.read(path, spacing=1e-3).density_at(at) == pytest.approx(density, rel=1e-3)
    outside = r"a\.\w+: it names '.*secret\.vtu', which is outside of its own folder"
    for name, told in (
        ("../secret.vtu", outside),
        (str(tmp_path / "secret.vtu"), outside),
        ("&#46;&#46;&#47;secret.vtu", outside),
        ("..\\secret.vtu", "outside of its own folder"),
        ("~/secret.vtu", outside),
        ("behind.vtu", "outside of its own folder"),
        ("pipe.vtu", r"which is not a regular file"),
        ("lost.vtu", "not there"),
    ):
        listing(list_of, name)
        with pytest.raises(ValueError, match=told):
            flow.read(path)
    text = listing(list_of, "&e;").read_text()
    list_of.write_text(f'<!DOCTYPE a [<!ENTITY e "../secret.vtu">]>{text}')
    with pytest.raises(ValueError, match=outside):
        flow.read(path)


def test_meshes_and_configurations_beside(tmp_path):
    """Set-up: a restart beside a link to a mesh elsewhere, or a pipe; a pipe as its configuration.

    Expected: a mesh is taken from its own folder, or from elsewhere if the caller names it; pipes are not waited for.
    """
    restart = writers.su2(tmp_path, binary=False)
    mesh = next(tmp_path.glob("*.su2"))
    (tmp_path / "elsewhere").mkdir()
    other = mesh.rename(tmp_path / "elsewhere/mesh.su2")
    (own := tmp_path / "own").mkdir()
    restart = restart.rename(own / restart.name)
    os.mkfifo(own / "a.cfg")
    (own / "mesh.su2").symlink_to(other)
    with pytest.raises(ValueError, match=r"mesh\.su2', which is outside of its own folder"):
        flow.read(restart)
    assert flow.read(restart, mesh=other).geometry == "planar"
    (own / "mesh.su2").unlink()
    os.mkfifo(own / "mesh.su2")
    with pytest.raises(ValueError, match=r"mesh\.su2', which is not a regular file"):
        flow.read(restart)
