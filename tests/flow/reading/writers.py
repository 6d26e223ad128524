"""Files of one smooth flow in every format: by the format's own library where Python has it, else by its description.

The flow is `rho` below, planar in the file's x and y, on a curvilinear grid of 31 x 21 points, unless a test asks for
other things.
"""

import struct
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import Dataset
from aerokernels.flow.reading.read import Reader, checked_options, field_of, reading_of

NI, NJ = 31, 21


def rho(x, y):
    """Density [kg/m3] at places [m]."""
    return 1.2 + 0.3 * np.sin(20.0 * x) * np.cos(15.0 * y)


def grid(ni: int | None = None, nj: int | None = None):
    """Places x and y [m] of a curvilinear grid, shape (nj, ni), i fastest."""
    i, j = np.meshgrid(np.linspace(0.0, 1.0, ni or NI), np.linspace(0.0, 1.0, nj or NJ))
    return 0.1 * i + 0.01 * j, 0.05 * j + 0.01 * np.sin(3.0 * i)


def quads(ni: int | None = None, nj: int | None = None) -> np.ndarray:
    """Corners of the cells of such a grid, shape (cell_count, 4)."""
    ni, nj = ni or NI, nj or NJ
    index = np.arange(ni * nj).reshape(nj, ni)
    corners = [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def cell_means(values: np.ndarray) -> np.ndarray:
    """Mean over the corners of each cell, shape (nj - 1, ni - 1)."""
    return 0.25 * (values[:-1, :-1] + values[1:, :-1] + values[1:, 1:] + values[:-1, 1:])


def field(blocks, *, name: str = "FILE", shared: Reader | None = None, dataset=None, **options):
    """The field that a reader's blocks make with the options of `flow.read`; `dataset` has more of the dataset."""
    contents = Dataset(blocks, "test", **(dataset or {}))
    return field_of(reading_of(name, contents, checked_options(options, "test")), shared)


def plot3d(
    path: Path,
    *,
    records: bool = True,
    order: str = "<",
    real: str = "f8",
    several: bool = True,
    blank=None,
    text=False,
):
    """A grid (.xyz) and a solution (.q) of two dimensions."""
    x, y = grid()
    density = rho(x, y)
    q = [density, 300.0 * density, 0.0 * density, 2.5e5 + 0.0 * density]
    head = ([1] if several else []), [NI, NJ]
    if text:
        numbers = [*head[0], *head[1], *x.ravel(), *y.ravel()]
        path.with_suffix(".xyz").write_text(
            " ".join(repr(float(v)) if isinstance(v, float) else str(v) for v in numbers)
        )
        numbers = [*head[0], *head[1], 0.5, 0.0, 1e5, 0.0, *np.concatenate([v.ravel() for v in q])]
        path.with_suffix(".q").write_text(" ".join(repr(float(v)) if isinstance(v, float) else str(v) for v in numbers))
        return path.with_suffix(".xyz")

    def record(*parts):
        data = b"".join(np.asarray(p, k).tobytes() for p, k in parts)
        mark = struct.pack(f"{order}I", len(data)) if records else b""
        return mark + data + mark

    integer, number = f"{order}i4", order + real
    begin = (record((head[0], integer)) if several else b"") + record((head[1], integer))
    body = [(x.ravel(), number), (y.ravel(), number)] + ([(blank.ravel(), integer)] if blank is not None else [])
    path.with_suffix(".xyz").write_bytes(begin + record(*body))
    conditions = record(([0.5, 0.0, 1e5, 0.0], number))
    path.with_suffix(".q").write_bytes(begin + conditions + record(*((v.ravel(), number) for v in q)))
    return path.with_suffix(".xyz")


def tecplot_text(path: Path, *, packing: str = "POINT", in_cells: bool = False, elements: bool = False) -> Path:
    """A Tecplot ASCII file with X, Y, p and Density."""
    x, y = grid()
    values = rho(x, y)
    lines = ['TITLE = "flow"', 'VARIABLES = "X" "Y"', '"p [Pa]"', '"Density"']
    size = (
        f"ZONETYPE=FEQUADRILATERAL, NODES={NI * NJ}, ELEMENTS={(NI - 1) * (NJ - 1)}" if elements else f"I={NI}, J={NJ}"
    )
    lines.append(f'ZONE T="all", {size}, DATAPACKING={"BLOCK" if in_cells else packing}')
    if in_cells:
        lines.append("VARLOCATION=([4]=CELLCENTERED)")
        columns = [x, y, 1e5 * values, cell_means(values)]
    else:
        columns = [x, y, 1e5 * values, values]
    if packing == "BLOCK" or in_cells:
        for own in columns:
            lines += [" ".join(repr(float(v)) for v in own.ravel()[k : k + 7]) for k in range(0, own.size, 7)]
    else:
        lines += [" ".join(repr(float(v)) for v in row) for row in np.stack([own.ravel() for own in columns], axis=1)]
    if elements:
        lines += [" ".join(str(v + 1) for v in row) for row in quads()]
    path.write_text("\n".join(lines) + "\n")
    return path


def tecplot_binary(path: Path, *, order: str = "<", elements: bool = False, in_cells: bool = False) -> Path:
    """A Tecplot binary file of version 112 with X, Y and rho, by Tecplot's data format guide."""
    x, y = grid()
    values = cell_means(rho(x, y)) if in_cells else rho(x, y)

    def whole(*v):
        return np.array(v, f"{order}i4").tobytes()

    def text(word):
        return whole(*(ord(c) for c in word), 0)

    head = b"#!TDV112" + whole(1, 0) + text("flow") + whole(3) + text("X") + text("Y") + text("rho")
    head += struct.pack(f"{order}f", 299.0) + text("zone") + whole(-1, -1) + struct.pack(f"{order}d", 0.0) + whole(-1)
    head += whole(3 if elements else 0)
    head += whole(1, 0, 0, 1) if in_cells else whole(0)
    head += whole(0, 0)
    cells = (NI - 1) * (NJ - 1)
    head += whole(NI * NJ, cells, 0, 0, 0) if elements else whole(NI, NJ, 1)
    head += whole(0) + struct.pack(f"{order}f", 357.0)
    body = struct.pack(f"{order}f", 299.0) + whole(2, 2, 2, 0, 0, -1)
    for own in (x, y, values):
        body += np.array([own.min(), own.max()], f"{order}f8").tobytes()
    for own in (x, y):
        body += own.astype(f"{order}f8").tobytes()
    if in_cells and not elements:
        padded = np.zeros((NJ - 1, NI))
        padded[:, :-1] = values
        values = padded
    body += values.astype(f"{order}f8").tobytes()
    if elements:
        body += quads().astype(f"{order}i4").tobytes()
    path.write_bytes(head + body)
    return path


def su2(folder: Path, *, binary: bool = True, order: str = "<") -> Path:
    """A mesh of SU2 with its restart: the path of the restart."""
    x, y = grid()
    lines = ["NDIME= 2", f"NELEM= {(NI - 1) * (NJ - 1)}"]
    lines += [f"9 {' '.join(map(str, row))} {k}" for k, row in enumerate(quads())]
    lines += [f"NPOIN= {NI * NJ}"]
    lines += [f"{a!r} {b!r} {k}" for k, (a, b) in enumerate(zip(x.ravel().tolist(), y.ravel().tolist(), strict=True))]
    lines += ["NMARK= 1", "MARKER_TAG= wall", f"MARKER_ELEMS= {NI - 1}"]
    lines += [f"3 {k} {k + 1}" for k in range(NI - 1)]
    (folder / "mesh.su2").write_text("\n".join(lines) + "\n")
    table = np.stack([x.ravel(), y.ravel(), rho(x, y).ravel(), 2.0 + x.ravel()], axis=1)
    names = ["x", "y", "Density", "Nu_Tilde"]
    if binary:
        head = np.array([535532, 4, NI * NJ, 0, 0], f"{order}i4").tobytes()
        head += b"".join(name.encode().ljust(33, b"\0") for name in names)
        path = folder / "restart_flow.dat"
        path.write_bytes(head + table.astype(f"{order}f8").tobytes() + np.zeros(8, f"{order}f8").tobytes())
        return path
    path = folder / "restart_flow.csv"
    rows = [", ".join([str(k), *(f"{v:.17g}" for v in row)]) for k, row in enumerate(table)]
    path.write_text("\n".join([", ".join(f'"{n}"' for n in ["PointID", *names]), *rows]) + "\n")
    return path


def foam_header(kind: str, name: str, binary: bool) -> bytes:
    """The head of a file of OpenFOAM."""
    form, arch = ("binary", '    arch "LSB;label=32;scalar=64";\n') if binary else ("ascii", "")
    entries = f"    version 2.0;\n    format {form};\n{arch}    class {kind};\n    object {name};\n"
    return f"/* for a test */\nFoamFile\n{{\n{entries}}}\n".encode()


def foam_list(values: np.ndarray, binary: bool) -> bytes:
    """A list of numbers or vectors."""
    if binary:
        kind = "<i4" if np.issubdtype(values.dtype, np.integer) else "<f8"
        return f"\n{len(values)}\n(".encode() + values.astype(kind).tobytes() + b")\n"
    word = (
        (lambda v: "(" + " ".join(repr(float(x)) for x in v) + ")") if values.ndim > 1 else (lambda v: repr(v.item()))
    )
    return (f"\n{len(values)}\n(\n" + "\n".join(word(v) for v in values) + "\n)\n").encode()


def foam_wedge(
    folder: Path,
    *,
    binary: bool = False,
    wedge: bool = True,
    time: str = "0.5",
    half_angle: float = 0.04,
    turn=None,
    shift=(0.0, 0.0, 0.0),
) -> Path:
    """An OpenFOAM case one cell thick: a wedge about x (or a plane), with a wall at the lowest row of points.

    The grid is (x, r) = `grid()` moved up by 0.02, the density is `rho` at the mean of each cell's corners. `turn`, a
    matrix, and `shift` move the points.
    """
    x, r = grid()
    r = r + 0.02
    n = NI * NJ
    if wedge:
        sides = [np.stack([x, r * np.cos(a), r * np.sin(a)], axis=-1).reshape(-1, 3) for a in (-half_angle, half_angle)]
    else:
        sides = [np.stack([x, r, np.full_like(x, z)], axis=-1).reshape(-1, 3) for z in (-0.001, 0.001)]
    points = np.concatenate(sides) @ (np.eye(3) if turn is None else turn).T + shift
    cell = np.arange((NI - 1) * (NJ - 1)).reshape(NJ - 1, NI - 1)
    index = np.arange(n).reshape(NJ, NI)
    faces, owner, neighbour = [], [], []
    pairs = [(c, c + 1, (j, i + 1), (j + 1, i + 1)) for (j, i), c in np.ndenumerate(cell) if i < NI - 2]
    pairs += [(c, c + NI - 1, (j + 1, i + 1), (j + 1, i)) for (j, i), c in np.ndenumerate(cell) if j < NJ - 2]
    for own, other, a, b in sorted(pairs):
        faces.append([index[a], index[b], index[b] + n, index[a] + n])
        owner.append(own)
        neighbour.append(other)
    boundary, patches = [], []

    def patch(name, kind, rows):
        patches.append((name, kind, len(faces) + len(boundary), len(rows)))
        boundary.extend(rows)

    patch(
        "body",
        "wall",
        [([index[0, i], index[0, i + 1], index[0, i + 1] + n, index[0, i] + n], cell[0, i]) for i in range(NI - 1)],
    )
    patch(
        "outer",
        "patch",
        [
            ([index[-1, i], index[-1, i] + n, index[-1, i + 1] + n, index[-1, i + 1]], cell[-1, i])
            for i in range(NI - 1)
        ],
    )
    patch(
        "inlet",
        "patch",
        [([index[j, 0], index[j, 0] + n, index[j + 1, 0] + n, index[j + 1, 0]], cell[j, 0]) for j in range(NJ - 1)],
    )
    patch(
        "outlet",
        "patch",
        [
            ([index[j, -1], index[j + 1, -1], index[j + 1, -1] + n, index[j, -1] + n], cell[j, -1])
            for j in range(NJ - 1)
        ],
    )
    lower = [(list(row[::-1]), c) for c, row in enumerate(quads())]
    upper = [(list(row + n), c) for c, row in enumerate(quads())]
    if wedge:
        patch("front", "wedge", lower)
        patch("back", "wedge", upper)
    else:
        patch("frontAndBack", "empty", lower + upper)
    faces += [row for row, _ in boundary]
    owner += [c for _, c in boundary]
    mesh = folder / "constant" / "polyMesh"
    mesh.mkdir(parents=True)
    (mesh / "points").write_bytes(foam_header("vectorField", "points", binary) + foam_list(points, binary))
    if binary:
        start = 4 * np.arange(len(faces) + 1)
        body = foam_list(start, True) + foam_list(np.array(faces).ravel(), True)
        (mesh / "faces").write_bytes(foam_header("faceCompactList", "faces", True) + body)
    else:
        rows = "\n".join(f"4({' '.join(map(str, row))})" for row in faces)
        (mesh / "faces").write_bytes(
            foam_header("faceList", "faces", False) + f"\n{len(faces)}\n(\n{rows}\n)\n".encode()
        )
    for name, values in (("owner", owner), ("neighbour", neighbour)):
        (mesh / name).write_bytes(foam_header("labelList", name, binary) + foam_list(np.array(values), binary))
    rows = "".join(f"    {name}\n    {{\n        type {kind};\n        inGroups 1({kind});\n        nFaces {count};\n"
                   f"        startFace {first};\n    }}\n" for name, kind, first, count in patches)  # fmt: skip
    (mesh / "boundary").write_bytes(
        foam_header("polyBoundaryMesh", "boundary", False) + f"{len(patches)}\n(\n{rows})\n".encode()
    )
    mean = [cell_means(v).ravel() for v in (x, r)]
    density = rho(*mean)
    (folder / time).mkdir()
    values = (
        b"dimensions [1 -3 0 0 0 0 0];\ninternalField nonuniform List<scalar>" + foam_list(density, binary) + b";\n"
    )
    (folder / time / "rho").write_bytes(
        foam_header("volScalarField", "rho", binary) + values + b"boundaryField\n{\n}\n"
    )
    return folder
