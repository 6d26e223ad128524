"""Small valid files in the formats that the package reads itself: four or six points each, as texts or bytes."""

import io
import struct

import numpy as np

TECPLOT_TEXTS = (
    'TITLE = "a"\nVARIABLES = "X" "Y" "rho"\nZONE T="all", I=2, J=2, DATAPACKING=POINT\n0 0 1\n1 0 1.1\n'
    "0 1 1.2\n1 1 1.3\n",
    'VARIABLES = X, Y, rho\nZONE I=3, J=2, F=BLOCK, VARLOCATION=([3]=CELLCENTERED), SOLUTIONTIME=0.5\n'
    "0 1 2 0 1 2\n3*0 3*1\n1.1 1.2\n",
    'VARIABLES = "X [mm]" "Y [mm]" "p" "T"\nZONE ZONETYPE=FETRIANGLE, NODES=4, ELEMENTS=2, DATAPACKING=POINT\n'
    "0 0 1e5 300\n1 0 1e5 300\n0 1 1e5 300\n1 1 1e5 3D2\n1 2 3\n2 4 3\n",
    'VARIABLES = "x" "r" "rho"\n"u"\nZONE N=4, E=1, ET=QUADRILATERAL, F=FEPOINT\n0 0 1 5\n1 0 1 5\n1 1 1 5\n0 1 1 5\n'
    '1 2 3 4\n# a comment\nZONE T="b" I=2,J=1,K=2\nAUXDATA a="b"\n0 0 1 5\n1 0 1 5\n1 1 1 5\n0 1 1 5\n',
)  # fmt: skip
SU2_MESH = (
    "% a comment\nNDIME= 2\nNELEM= 2\n5 0 1 2 0\n9 1 3 4 2 1\nNPOIN= 5\n0 0 0\n1 0 1\n0 1 2\n2 0 3\n2 1 4\nNMARK= 2\n"
    "MARKER_TAG= wall\nMARKER_ELEMS= 2\n3 0 1\n3 1 3\nMARKER_TAG= far\nMARKER_ELEMS= 1\n3 3 4\n",
    "NZONE= 2\nIZONE= 1\nNDIME= 3\nNPOIN= 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\nNELEM= 1\n10 0 1 2 3\n"
    "NMARK= 1\nMARKER_TAG= body\n"
    "MARKER_ELEMS= 1\n5 0 1 2\nIZONE= 2\nNDIME= 3\nNPOIN= 4\n0 0 0\n1 0 0\n0 1 0\n0 0 2\nNELEM= 1\n10 0 1 2 3\n",
)  # fmt: skip
SU2_TABLE = '"PointID","x","y","Density"\n0,0,0,1.1\n1,1,0,1.2\n2,0,1,1.3\n3,2,0,1.4\n4,2,1,1.5\n'
TABLES = (
    "x,y,rho\n0,0,1.1\n1,0,1.2\n0,1,1.3\n1,1,1.4\n",
    "# x [mm] y [mm] rho [kg/m3]\n0 0 1.1\n1 0 1.2\n0 1 1.3\n1.5 1 1.4\n0.5 0.4 1.2\n",
    "r;z;rho\n0,0;0,5;1,1\n1;0;1\n0;1;1\n1;1;1\n0;2;1\n1;2;1\n",
    '"Points:0"\t"Points:1"\t"Points:2"\t"p"\t"T"\n0\t0\t0\t1e5\t300\n1\t0\t0\t1e5\t300\n0\t1\t0\t1e5\t300\n0\t0\t1\t1e5\t300\n',
)  # fmt: skip
COLLECTION = (
    '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n'
    '<DataSet timestep="0" part="0" file="a_0.vtu"/>\n<DataSet timestep="1e-5" file="a_1.vtu"/>\n'
    "</Collection>\n</VTKFile>\n"
)  # fmt: skip
FILE_SERIES = (
    '{\n  "file-series-version" : "1.0",\n  "files" : [\n    { "name" : "a_0.vtu", "time" : 0 },\n'
    '    { "name" : "a_1.vtu", "time" : 1e-5 }\n  ]\n}\n'
)  # fmt: skip


def su2_restart(order: str) -> bytes:
    """A binary restart of the mesh with five points."""
    table = np.array([[0, 0, 1.1], [1, 0, 1.2], [0, 1, 1.3], [2, 0, 1.4], [2, 1, 1.5]])
    names = b"".join(name.ljust(33, b"\0") for name in (b"x", b"y", b"Density"))
    return struct.pack(f"{order}5i", 535532, 3, 5, 0, 0) + names + table.astype(f"{order}f8").tobytes()


def plot3d(order: str, real: int, records: bool, several: bool, blank: bool, functions: bool) -> tuple[bytes, bytes]:
    """A grid of 2 x 2 points and its solution, or its functions."""
    x, y, rho = np.array([0.0, 1, 0, 1]), np.array([0.0, 0, 1, 1]), np.array([1.1, 1.2, 1.3, 1.4])

    def record(*parts: bytes) -> bytes:
        data = b"".join(parts)
        mark = struct.pack(f"{order}I", len(data)) if records else b""
        return mark + data + mark

    def reals(*values: np.ndarray) -> bytes:
        return np.concatenate(values).astype(f"{order}f{real}").tobytes()

    begin = record(struct.pack(f"{order}i", 1)) if several else b""
    shape = struct.pack(f"{order}2i", 2, 2)
    hidden = struct.pack(f"{order}4i", 1, 1, 0, 1) if blank else b""
    grid = begin + record(shape) + record(reals(x, y), hidden)
    if functions:
        return grid, begin + record(shape + struct.pack(f"{order}i", 2)) + record(reals(rho, rho))
    return grid, begin + record(shape) + record(reals(np.array([0.5, 0, 1e5, 0]))) + record(
        reals(rho, rho, 0 * rho, rho)
    )


PLOT3D_TEXTS = ("1\n2 2\n0 1 0 1\n0 0 1 1\n", "1\n2 2\n0.5 0 1e5 0\n1.1 1.2 1.3 1.4\n1 1 1 1\n0 0 0 0\n2 2 2 2\n")


def tecplot_binary(order: str, version: int, elements: bool, in_cells: bool) -> bytes:
    """A file of versions 107 to 112 with X, Y and rho."""

    def whole(*values: int) -> bytes:
        return struct.pack(f"{order}{len(values)}i", *values)

    def text(word: str) -> bytes:
        return whole(*map(ord, word), 0)

    head = b"#!TDV" + str(version).encode() + whole(1) + (whole(0) if version >= 111 else b"") + text("a") + whole(3)
    head += text("X") + text("Y") + text("rho") + struct.pack(f"{order}f", 299.0) + text("z") + whole(-1, -1)
    head += struct.pack(f"{order}d", 0.0) + whole(-1, 2 if elements else 0) + (b"" if version == 112 else whole(0))
    head += (whole(1, 0, 0, 1) if in_cells else whole(0)) + whole(0, 0)
    head += (whole(4, 2, 0, 0, 0) if elements else whole(2, 2, 1)) + whole(0) + struct.pack(f"{order}f", 357.0)
    body = struct.pack(f"{order}f", 299.0) + whole(2, 1, 2, 0, 0, -1)
    x, y = np.array([0.0, 1, 0, 1]), np.array([0.0, 0, 1, 1])
    rho = np.array([1.1, 1.2]) if in_cells else np.array([1.1, 1.2, 1.3, 1.4])
    for own in (x, y, rho):
        body += struct.pack(f"{order}2d", own.min(), own.max())
    body += x.astype(f"{order}f8").tobytes() + y.astype(f"{order}f4").tobytes() + rho.astype(f"{order}f8").tobytes()
    return head + body + (whole(0, 1, 2, 1, 3, 2) if elements else b"")


def npy(values: np.ndarray) -> bytes:
    """An array as stored in an NPZ file."""
    stream = io.BytesIO()
    np.lib.format.write_array(stream, values)
    return stream.getvalue()


def foam_case(binary: bool, kind: str) -> dict[str, bytes]:
    """A case of two adjacent cells, by the names of its files; `kind` is the type of its front and back patches."""
    z = np.repeat([-0.05, 0.05], 6)
    points = np.stack([np.tile([0.0, 1, 2, 0, 1, 2], 2), np.tile(np.repeat([0.1, 1.0], 3), 2), z], axis=1)
    faces = [[1, 4, 10, 7], [0, 6, 9, 3], [2, 5, 11, 8], [0, 1, 7, 6], [1, 2, 8, 7], [3, 9, 10, 4], [4, 10, 11, 5],
             [0, 3, 4, 1], [1, 4, 5, 2], [6, 7, 10, 9], [7, 8, 11, 10]]  # fmt: skip
    owner = [0, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]

    def head(name: str) -> bytes:
        form = 'binary; arch "LSB;label=32;scalar=64"' if binary else "ascii"
        return f"FoamFile {{ version 2.0; format {form}; class {name}; object a; }}\n".encode()

    def numbers(values: np.ndarray) -> bytes:
        if binary:
            return f"{len(values)}\n(".encode() + values.tobytes() + b")\n"
        rows = (f"({' '.join(map(repr, row))})" if isinstance(row, list) else repr(row) for row in values.tolist())
        return f"{len(values)}\n(\n".encode() + "\n".join(rows).encode() + b"\n)\n"

    if binary:
        start = np.arange(0, 4 * len(faces) + 1, 4, dtype="<i4")
        listed = head("faceCompactList") + numbers(start) + numbers(np.concatenate(faces).astype("<i4"))
    else:
        listed = head("faceList") + f"{len(faces)}\n(\n".encode()
        listed += "".join(f"4({' '.join(map(str, face))})\n" for face in faces).encode() + b")\n"
    patches = (("ends", "patch", 1, 2), ("low", "wall", 3, 2), ("top", "patch", 5, 2), ("back", kind, 7, 2),
               ("front", kind, 9, 2))  # fmt: skip
    boundary = f"{len(patches)}\n(\n" + "".join(
        f"{name} {{ type {word}; inGroups 1({word}); nFaces {count}; startFace {first}; }}\n"
        for name, word, first, count in patches
    )
    rho = b"dimensions [1 -3 0 0 0 0 0];\ninternalField nonuniform List<scalar>\n" + numbers(np.array([1.1, 1.2]))
    mesh = "constant/polyMesh"
    return {
        f"{mesh}/points": head("vectorField") + numbers(points),
        f"{mesh}/faces": listed,
        f"{mesh}/owner": head("labelList") + numbers(np.array(owner, "<i4")),
        f"{mesh}/neighbour": head("labelList") + numbers(np.array([1], "<i4")),
        f"{mesh}/boundary": head("polyBoundaryMesh") + boundary.encode() + b")\n",
        "0.5/rho": head("volScalarField") + rho + b';\nboundaryField { ".*" { type calculated; } }\n',
        "0.5/p": head("volScalarField") + b"p0 1e5;\ninternalField uniform $p0;\n",
        "constant/thermophysicalProperties": b"mixture { specie { molWeight 28.9; } } // air\n",
    }
