"""Random flow files, read by their own reader in this process: the result is consistent, or refused in words.

Reading a whole file, with its grid and its body, takes milliseconds (`damaged_files.py`); here only the part that this
package parses itself is run, on small files, in memory or on a disk of memory. The results of VTK and HDF5 are varied
in tree_draws.py. As in input_draws.py, any other outcome is raised as an exception.
"""

import io
import random
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import Dataset, ReadError, with_all_points
from aerokernels.flow.reading.density import Reference, beside_the_flow, block_density, choose_density
from aerokernels.flow.reading.formats import read_here
from aerokernels.flow.reading.readers.foam_file import FoamFile
from aerokernels.process.opened import OPENED

from . import sound_files
from .input_draws import Draw
from .refusals import check_refusal
from .spoiling import spoilt_numbers, spoilt_text

NO_ROOM = "than the memory takes"  # must not be said of small files: their counts are checked before allocation
MOST_VALUES = 1_000_000  # in files of some kilobytes; a larger number comes from a damaged count


def check_dataset(path: Path, found: Dataset) -> bool:
    """Check that arrays fit their points and cells, that cells refer to existing points, and densities are positive."""
    found = with_all_points(found)
    for block in found.blocks:
        count = len(block.points)
        if block.points.dtype != np.float64 or block.points.shape != (count, 3) or count > MOST_VALUES:
            raise AssertionError(f"points {block.points.dtype} {block.points.shape}")
        if block.shape is not None and (min(block.shape) < 1 or np.prod(block.shape, dtype=float) != count):
            raise AssertionError(f"{count} points of shape {block.shape}")
        if (cells := block.cells) is not None and cells.faces is None:
            good = len(cells.start) == len(cells) + 1 and cells.start[-1] == len(cells.points)
            if not (good and (np.diff(cells.start) >= 0).all() and 0 <= cells.points.min(initial=0)) or (
                cells.points.max(initial=-1) >= count
            ):
                raise AssertionError(f"cells of {path} do not hang together")
        for name, values in block.point_data.items():
            if len(values) != count:
                raise AssertionError(f"{name!r} has {len(values)} values at {count} points")
        for name in block.cell_data:
            if len(block.cell_data[name]) != block.cell_count:
                raise AssertionError(f"{name!r} has another number of values than there are cells")
    choice = choose_density(path, found, None, None)
    for block in found.blocks:
        values, where = block_density(path, block, choice, Reference(), found.units)
        hidden = (
            block.blank if block.blank is not None and len(block.blank) == len(values) else np.zeros(len(values), bool)
        )
        if where == "cell" and (beside := beside_the_flow(block)) is not None:
            hidden = hidden | beside
        if not (np.isfinite(values[~hidden]).all() and (values[~hidden] > 0.0).all()):
            raise AssertionError("densities of a gas")
    return True


def _read(path: Path, module: str, options: dict | None = None) -> bool:
    try:
        return check_dataset(path, read_here(module, path, None, options or {}))
    except ReadError as fault:
        return check_refusal(fault, path.parent, NO_ROOM)
    except ValueError as fault:  # unknown names of arrays and gases
        return check_refusal(fault, path, NO_ROOM)


def _drawn_file(name: str, module: str, make: Callable[[random.Random], bytes]) -> Draw:
    def draw_one(draw: random.Random, folder: Path) -> bool:
        path = folder / name
        path.write_bytes(make(draw))
        return _read(path, module)

    return draw_one


def _order(draw: random.Random) -> str:
    return draw.choice("<<>")


def _tecplot_binary(draw: random.Random) -> bytes:
    order, version = _order(draw), draw.choice((107, 111, 112, 112))
    made = sound_files.tecplot_binary(order, version, draw.random() < 0.5, draw.random() < 0.3)
    return spoilt_numbers(made, draw, order)


def foam_file(draw: random.Random, folder: Path) -> bool:
    """Lists, words and dictionaries of OpenFOAM, read in random order."""
    parts = ("3(1 2 3)", "2((0 0 0) (1 1 1))", "4{1.5}", "2(4(0 1 2 3) 3(2 1 0))", "0()", "0", "5", "List<scalar>",
             "{ a 1; b (x y); }", "// c\n", "/* c */", "(", ")", '"a b"', ";", "12345678901234567890(")  # fmt: skip
    binary, order = draw.random() < 0.4, _order(draw)
    arch = draw.choice(("LSB;label=32;scalar=64", "MSB;label=64;scalar=32", "label=0", "label=9", "scalar=16"))
    if order == ">" and draw.random() < 0.8:
        arch = "MSB;label=32;scalar=64"
    kind = draw.choice(("faceCompactList", "labelList", "volScalarField"))
    head = f'FoamFile {{ format {"binary" if binary else "ascii"}; arch "{arch}"; class {kind}; }}\n'
    body = "\n".join(draw.choice(parts) for _ in range(draw.randrange(1, 8)))
    data = head.encode() + spoilt_text(body, draw) if draw.random() < 0.8 else spoilt_text(head + body, draw)
    if binary:
        values = np.arange(3, dtype=f"{order}i4")
        data += b"\n3(" + spoilt_numbers(values.tobytes() + b")\n4(" + np.arange(4.0).tobytes() + b")", draw, order)
    path = folder / "drawn"
    path.write_bytes(data)
    taken = False
    try:
        file = FoamFile(path)
        for _ in range(8):
            ask = draw.randrange(6)
            begin = file.at
            if ask == 0:
                file.word()
            elif ask == 1:
                start, points = file.faces()
                if start[0] != 0 or start[-1] != len(points) or (np.diff(start) < 3).any():
                    raise AssertionError("faces do not hang together")
            elif ask == 2:
                file.expect(draw.choice((b"(", b")", b"{")))
            elif ask == 3:
                file.count()
            else:
                values = file.numbers(draw.choice((file.label, file.scalar)), draw.choice((1, 1, 3)), 10)
                if values.size > max(len(data), 10) * 3:
                    raise AssertionError(f"{values.size} numbers of {len(data)} bytes")
            if file.at < begin or file.at > len(data):
                raise AssertionError("the cursor goes on")
            taken = True
    except ReadError as fault:
        check_refusal(fault, path, NO_ROOM)
    except (TypeError, ValueError, OverflowError):  # `read_here` turns these into a refusal
        return False
    return taken


def foam_case(draw: random.Random, folder: Path) -> bool:
    """A case of two cells with one spoilt file."""
    key = draw.random() < 0.4, draw.choice(("empty", "wedge", "patch"))
    case = folder / f"case-{key[0]:d}-{key[1]}"
    files = OPENED.once(("foam case", *key), lambda: sound_files.foam_case(*key))
    if not case.is_dir():
        for name, data in files.items():
            (case / name).parent.mkdir(parents=True, exist_ok=True)
            (case / name).write_bytes(data)
    name = draw.choice(list(files))
    try:
        if key[0]:
            data = spoilt_numbers(files[name], draw) if draw.random() < 0.7 else _latin(files[name], draw)
        else:
            data = spoilt_text(files[name].decode(), draw)
        (case / name).write_bytes(data)
        return _read(case, "foam_case")
    finally:
        (case / name).write_bytes(files[name])


def _latin(data: bytes, draw: random.Random) -> bytes:
    return spoilt_text(data.decode("latin-1"), draw).decode("utf-8", "replace").encode("latin-1", "replace")


def su2(draw: random.Random, folder: Path) -> bool:
    """A mesh of SU2 and its restart, as text or binary; one of them is spoilt."""
    binary, order, of_mesh = draw.random() < 0.5, _order(draw), draw.random() < 0.5
    made = draw.choice(sound_files.SU2_MESH) if of_mesh else sound_files.SU2_MESH[0]
    mesh = folder / "mesh.su2"
    mesh.write_bytes(spoilt_text(made, draw) if of_mesh else made.encode())
    path = folder / ("restart.dat" if binary else "restart.csv")
    restart = sound_files.su2_restart(order) if binary else sound_files.SU2_TABLE.encode()
    if not of_mesh:
        restart = spoilt_numbers(restart, draw, order) if binary else spoilt_text(sound_files.SU2_TABLE, draw)
    path.write_bytes(restart)
    return _read(path, "su2", {"mesh": mesh})


def plot3d(draw: random.Random, folder: Path) -> bool:
    """A grid of Plot3D and its solution or functions, of any form; one of them is spoilt."""
    order = _order(draw)
    if draw.random() < 0.3:
        pair = [spoilt_text(text, draw) if k == draw.randrange(2) else text.encode()
                for k, text in enumerate(sound_files.PLOT3D_TEXTS)]  # fmt: skip
    else:
        form = draw.choice((8, 8, 4)), *(draw.random() < share for share in (0.5, 0.7, 0.3, 0.3))
        pair = list(sound_files.plot3d(order, *form))
        which = draw.randrange(2)
        pair[which] = spoilt_numbers(pair[which], draw, order)
    path, solution = folder / "a.xyz", folder / "a.q"
    path.write_bytes(pair[0])
    solution.write_bytes(pair[1])
    return _read(path, "plot3d", {"solution": solution})


def npz(draw: random.Random, folder: Path) -> bool:
    """An NPZ file whose arrays have other names, shapes, types and headings, or whose bytes are spoilt."""
    kinds = ("<f8", "<f8", "<f8", ">f4", "<i4", "?", "<U3", "<c16", "<M8[ns]", "<f2")
    shapes: tuple[tuple[int, ...], ...] = ((2,), (3,), (2, 3), (2, 3), (3, 2), (6,), (), (0,), (2, 2, 3), (1, 2))
    arrays = {"x": np.arange(2.0), "y": np.arange(3.0), "rho": np.full((2, 3), 1.1)}
    if draw.random() < 0.3:
        arrays = {"x": np.arange(6.0), "y": np.arange(6.0) ** 2, "rho": np.full(6, 1.1)}
    for _ in range(draw.choice((0, 1, 1, 2))):
        name = draw.choice((*arrays, "t", "z", "r", "x [mm]", "p", "T [K]", "rho [kg/m3]", "a/b", "../x", "é", ""))
        arrays[name] = np.ones(draw.choice(shapes)).astype(draw.choice(kinds))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, values in arrays.items():
            data = sound_files.npy(values)
            if draw.random() < 0.2:
                heading, rest = data[10:128].decode("latin-1"), data[128:]
                data = data[:10] + spoilt_text(heading, draw)[:118].ljust(118) + rest
            file.writestr(zipfile.ZipInfo(f"{name}.npy" if draw.random() < 0.97 else name), data)
    data = stream.getvalue()
    path = folder / "a.npz"
    path.write_bytes(spoilt_numbers(data, draw) if draw.random() < 0.4 else data)
    return _read(path, "npz")


def words_of(texts: tuple[str, ...]) -> Callable[[random.Random], bytes]:
    """Return a function that spoils one of the texts."""
    return lambda draw: spoilt_text(draw.choice(texts), draw)


DRAWS: dict[str, Draw] = {
    "foam-file": foam_file,
    "foam-case": foam_case,
    "tecplot-text": _drawn_file("a.dat", "tecplot_text", words_of(sound_files.TECPLOT_TEXTS)),
    "tecplot-binary": _drawn_file("a.plt", "tecplot_binary", _tecplot_binary),
    "su2": su2,
    "plot3d": plot3d,
    "point-table": _drawn_file("a.csv", "point_table", words_of(sound_files.TABLES)),
    "npz": npz,
}
