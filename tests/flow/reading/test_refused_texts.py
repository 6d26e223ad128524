"""What each reader of texts and arrays says of a file that is not what it announces: one line, the file, what is wrong.

Each case is a sound file of four points with one thing changed; the sound ones are read.
"""

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.formats import load

POINTS = "0 0 1\n1 0 1\n0 1 1\n1 1 1\n"
TECPLOT = f"TITLE = t\nVARIABLES = X, Y,\nrho\n# a comment\nZONE I=2, J=2, F=POINT\n{POINTS}"
ELEMENTS = f"VARIABLES = X Y rho\nZONE N=4, E=1, F=FEPOINT, ET=QUADRILATERAL\n{POINTS}1 2 4 3\n"
TIMED = "".join(f"ZONE I=2, J=2, F=POINT, SOLUTIONTIME={t}\n{POINTS}" for t in (0.5, 1.5))
MESH = (
    "NDIME= 2\nNELEM= 1\n9 0 1 3 2 0\nNPOIN= 4\n0 0\n1 0\n0 1\n1 1\nNMARK= 1\nMARKER_TAG= w\nMARKER_ELEMS= 1\n3 0 1\n"
)
ARRAYS = {"x": np.arange(3.0), "y": np.arange(2.0), "rho": np.ones((3, 2))}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("VARIABLES", "VARIABELS", "it has no VARIABLES or no ZONE"),
        ("0 1 1\n", "0 1 one\n", "'one|contains something that is not a number"),
        ("0 1 1\n", "", r"zone 1 announces 12 numbers and has 9"),
        ("I=2", "I=0", "zone 1 has the count '0'"),
        ("F=POINT", "ZONETYPE=FEBLOB", r"zone 1 is of type FEBLOB; known are|zone 1 is of type FEBLOB"),
        ("F=POINT", "F=POINT, VARSHARELIST=([1]=1)", "zone 1 shares data with zone 1, which is not before it"),
        ("F=POINT", "F=BLOCK, VARLOCATION=([4]=CELLCENTERED)", "VARLOCATION names variable 4 of 3"),
        ("F=POINT", "F=BLOCK, VARLOCATION=([3-99999999999]=CELLCENTERED)", "VARLOCATION names variable 9+ of 3"),
        ("X, Y", "A, B", "no coordinates are known"),
        ("X, Y", "\0, Y", "it contains zero bytes"),
    ],
)
def test_tecplot(tmp_path, old, new, told):
    path = tmp_path / "a.dat"
    path.write_text(TECPLOT)
    assert load(path, None, {}).blocks[0].points.shape == (4, 3)
    assert old in TECPLOT
    path.write_text(TECPLOT.replace(old, new))
    with pytest.raises(ReadError, match=told) as refused:
        load(path, None, {})
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)


def test_tecplot_elements_and_times(tmp_path):
    path = tmp_path / "a.dat"
    path.write_text(ELEMENTS.replace("1 2 4 3", "1 2 4 4"))  # a corner twice: a triangle
    assert load(path, None, {}).blocks[0].cells.points.tolist() == [0, 1, 3]
    for corners in ("1 2 4 5", "0 1 2 3", "1 2 4 3.5"):
        path.write_text(ELEMENTS.replace("1 2 4 3", corners))
        with pytest.raises(ReadError, match="refer to nodes beyond the 4 that there are"):
            load(path, None, {})
    path.write_text("VARIABLES = X Y rho\n" + TIMED.replace("1 1 1\n", "2*1 1\n"))
    assert [load(path, time, {}).time for time in (None, "first", "latest", 0.5)] == [1.5, 0.5, 1.5, 0.5]
    with pytest.raises(ReadError, match=r"there is no time 1\.0.*take one of 0\.5, 1\.5"):
        load(path, 1.0, {})
    path.write_text(TECPLOT)
    with pytest.raises(ReadError, match=r"it has one time only, not t = 3\.0"):
        load(path, 3.0, {})


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("NDIME= 2", "NDIME= 4", "line 1: 4 dimensions"),
        ("NELEM= 1", "NELEM= one", "line 2: a count must be a whole number, got 'one'"),
        ("NELEM= 1", "NELEM= 99", "line 2: NELEM= 99, but only 10 lines follow"),
        ("9 0 1 3 2 0", "170 0 1 3 2 0", "element 170 is of high order"),
        ("9 0 1 3 2 0", "9 0 1 3 4 0", "elements refer to points beyond the 4"),
        ("0 1\n1 1", "0 one\n1 1", "a point needs 2 coordinates, got '0 one'"),
        ("3 0 1\n", "3 0 7\n", "marker w refers to points beyond the 4"),
    ],
)
def test_su2(tmp_path, old, new, told):
    path = tmp_path / "a.su2"
    path.write_text(MESH)
    sound = load(path, None, {})
    assert sound.blocks[0].points.shape == (4, 3) and sound.patches[0].edges.tolist() == [[[0, 0, 0], [1, 0, 0]]]
    path.write_text(MESH.replace(old, new), encoding="utf-8")
    with pytest.raises(ReadError, match=told):
        load(path, None, {})


def test_su2_restarts_that_do_not_belong_to_the_mesh(tmp_path):
    mesh, restart = tmp_path / "a.su2", tmp_path / "a.csv"
    mesh.write_text(MESH)
    head = '"PointID","x","y","Density"\n'
    rows = ["0,0,0,1\n", "1,1,0,1\n", "2,0,1,1\n", "3,1,1,1\n"]
    restart.write_text(head + "".join(rows))
    assert set(load(mesh, None, {}).blocks[0].point_data) == {"Density"}
    restart.write_text(head + "".join(rows[:3]))
    with pytest.raises(ReadError, match=r"it holds \[3\] points, the mesh a\.su2 4"):
        load(restart, None, {})
    restart.write_text(head + "".join([*rows[:3], "3,1,2,1\n"]))
    with pytest.raises(ReadError, match=r"its points are not where the mesh has them \(column y\)"):
        load(restart, None, {})
    (tmp_path / "b.csv").write_text(head + "".join(rows))
    with pytest.raises(ReadError, match=r"several restarts are beside it \(a\.csv, b\.csv\)"):
        load(mesh, None, {})


@pytest.mark.parametrize(
    ("changes", "variables", "told"),
    [
        ({"x": None, "y": None}, {}, r"no coordinates are known \(there are: rho\)"),
        ({}, {"phi": "x"}, "variables: 'phi' is not a coordinate"),
        ({"x": np.ones((3, 2))}, {}, "coordinates have shapes"),
        ({"rho": np.ones((4, 4))}, {}, r"no array has a sample for each of the \(3, 2\) places"),
    ],
)
def test_arrays_by_name(tmp_path, changes, variables, told):
    path = tmp_path / "a.npz"
    np.savez(path, **{name: array for name, array in {**ARRAYS, **changes}.items() if array is not None})
    with pytest.raises(ReadError, match=told):
        load(path, None, {"variables": variables})


def test_a_file_of_objects_says_that_they_are_not_unpickled(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, rho=np.array({"x": [0.0, 1.0]}, dtype=object))
    with pytest.raises(ReadError, match="only Python objects, which are never unpickled"):
        load(path, None, {})
    np.savez(path, **{**ARRAYS, "rho": np.ones((2, 3))})  # as C programs have it: z, y, x
    assert load(path, None, {}).blocks[0].point_data["rho"].shape == (6,)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ReadError, match="it cannot be read"):
        load(path, None, {})


@pytest.mark.parametrize(
    ("name", "head", "message"),
    [
        ("a.xdmf", b"<?xml", "a file of XDMF, which is not read"),
        ("a.plt.gz", b"\x1f\x8b", "it is compressed, which is not read: unpack it"),
        ("a.npy", b"\x93NUMPY", "an array without coordinates, which is not read: save them with it"),
        ("a.cgns", b"version https://git-lfs.github.com/spec/v1\noid sha256:1", "a pointer of Git LFS: fetch the file"),
    ],
)
def test_foreign_files_are_refused_with_what_to_do(tmp_path, name, head, message):
    (tmp_path / name).write_bytes(head)
    with pytest.raises(ReadError, match=message):
        flow.read(tmp_path / name)
