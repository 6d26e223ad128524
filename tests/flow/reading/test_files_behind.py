"""The files that are read with a path, to whose contents kept results belong."""

from pathlib import Path

import pytest

from aerokernels.flow.reading.formats import files_behind, stamp
from aerokernels.jobs.sweeps.definition import content_hashes


def touch(folder: Path, *names: str) -> list[Path]:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    return [folder / name for name in names]


def case(folder: Path) -> Path:
    touch(folder, "constant/polyMesh/points", "constant/polyMesh/faces", "constant/gas", "system/controlDict", "a.foam")
    touch(folder, "0.1/rho", "0.1/U", "0.2/rho")
    return folder / "a.foam"


def pieces(folder: Path) -> Path:
    touch(folder, "a.vtm", "a/0.pvtu", "a/0/0.vtu", "a/0/1.vtu", "a/other.vtu")
    (folder / "a/0.pvtu").write_text('<VTKFile><Piece Source="0/0.vtu"/><Piece Source="0/1.vtu"/></VTKFile>')
    (folder / "a.vtm").write_text("<VTKFile><DataSet index='0' file='a/0.pvtu'/></VTKFile>")
    (folder / "a.pvd").write_text('<VTKFile><DataSet timestep="0.5" file="a.vtm"/></VTKFile>')
    return folder / "a.pvd"


def plot3d(folder: Path) -> Path:
    return touch(folder, "a.q", "a.xyz", "b.xyz")[0]


def su2(folder: Path) -> Path:
    (restart,) = touch(folder, "flow.csv")
    restart.write_text('"PointID","x","y","Density"\n')
    touch(folder, "mesh.su2", "notes.txt")
    return restart


@pytest.mark.parametrize(
    ("made", "names"),
    [
        (case, "0.1/U 0.1/rho 0.2/rho constant/gas constant/polyMesh/faces constant/polyMesh/points"),
        (pieces, "a.pvd a.vtm a/0.pvtu a/0/0.vtu a/0/1.vtu"),
        (plot3d, "a.q a.xyz"),
        (su2, "flow.csv mesh.su2"),
    ],
)
def test_a_kept_result_belongs_to_all_files_that_are_read(made, names: str, tmp_path: Path):
    """Each of them changes the hash by which a sweep knows its flow, and the stamp of a series; no other file does."""
    path = made(tmp_path)
    files = files_behind(path)
    assert sorted(file.relative_to(tmp_path).as_posix() for file in files) == names.split()
    kept, stamped = content_hashes([path]), stamp(files)
    touch(tmp_path, "sweep/cases.jsonl", "another.txt")  # such as results in the same folder
    assert content_hashes([path]) == kept and stamp(files_behind(path)) == stamped
    for file in files:
        text = file.read_text()
        file.write_text(text + " ")
        assert content_hashes([path]) != kept and stamp(files_behind(path)) != stamped
        file.write_text(text)
    assert content_hashes([path]) == kept


def test_of_one_time_only_its_own_files(tmp_path: Path):
    path = case(tmp_path)
    found = [file.relative_to(tmp_path).as_posix() for file in files_behind(path, time=0.2)]
    assert found == ["constant/gas", "constant/polyMesh/faces", "constant/polyMesh/points", "0.2/rho"]


def test_of_what_cannot_be_read_it_is_the_file_or_the_folder(tmp_path: Path):
    (file,) = touch(tmp_path, "folder/a.unknown")
    assert files_behind(file) == files_behind(file.parent) == [file]
    missing = tmp_path / "missing.vtu"
    assert files_behind(missing) == [missing] and stamp([missing]) != stamp([])
