"""Plot3D: a grid and its solution (q) or functions (f), binary of either kind and byte order, or ascii.

What a file does not say of itself (records of Fortran or plain bytes, byte order, precision, several grids or one, two
or three dimensions, iblank) follows from its size: only one reading fits to the last byte. A file that fits none is
damaged.

    grid       [grids]  ni nj [nk] ...   x y [z] [iblank], i fastest
    q          [grids]  ni nj [nk] ...   mach alpha re time   rho rho_u rho_v [rho_w] e
    functions  [grids]  ni nj [nk] n ... f1 ... fn
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from .dataset import Block, Dataset, ReadError

DAMAGED = "the file is damaged, or no file of Plot3D: write it again"
GRID_ENDS = (".xyz", ".x", ".g", ".p3d", ".grd", ".p2d")
SOLUTION_ENDS = (".q", ".f", ".fun", ".p3dq")
GREATEST_GRID_COUNT = 100_000
PADDING = 1024  # bytes of a block on a disk or tape
CONSERVATIVE = ("density", "momentum_x", "momentum_y", "momentum_z", "energy")


@dataclass(frozen=True, eq=False)
class _Form:
    """One way in which the bytes may be meant."""

    order: str
    real: int
    records: bool
    several: bool
    dimension: int
    iblank: bool = False

    def described(self) -> str:
        """In words."""
        kind = "Fortran records" if self.records else "plain binary"
        return f"{kind}, {'little' if self.order == '<' else 'big'} endian, float{8 * self.real}"


def read(path: Path, time: Any = None, options: dict | None = None) -> Dataset:
    """Read a grid with its solution; either may be named, the other lies beside it or is given as an option.

    Raises:
        ReadError: A file that fits no form, or a solution that does not fit the grid.
    """
    grid_path, solution_path = _pair(path, (options or {}).get("solution"))
    blocks, form = _read_grid(grid_path)
    arrays = _read_solution(solution_path, [block.shape for block in blocks if block.shape])
    whole = [
        Block(block.points, None, block.shape, own, {}, block.blank, f"grid {k + 1}")
        for k, (block, own) in enumerate(zip(blocks, arrays, strict=True))
    ]
    return Dataset(whole, f"Plot3D, {form}")


def _pair(path: Path, solution) -> tuple[Path, Path]:
    if solution is not None:
        return path, Path(solution)
    ends, others = (GRID_ENDS, SOLUTION_ENDS) if path.suffix.lower() in GRID_ENDS else (SOLUTION_ENDS, GRID_ENDS)
    beside = [other for other in sorted(path.parent.iterdir()) if other.suffix.lower() in others and other.is_file()]
    same = [other for other in beside if other.stem == path.stem] or beside
    if len(same) != 1:
        found = ", ".join(other.name for other in same) or "none"
        need = "solution" if ends is GRID_ENDS else "grid"
        raise ReadError(
            path, f"its {need} is not clear (beside it: {found})", f"name it: solution = PATH ({need} file)"
        )
    return (path, same[0]) if ends is GRID_ENDS else (same[0], path)


def _read_grid(path: Path) -> tuple[list[Block], str]:
    data = path.read_bytes()
    for form in _forms(True):
        found = _sections(data, form, lambda n, f: f.dimension * n * f.real + (4 * n if f.iblank else 0))
        if found is not None:
            shapes, sections = found
            blocks = [_grid_block(section, shape, form) for section, shape in zip(sections, shapes, strict=True)]
            if all(_plausible(block) for block in blocks):
                return blocks, form.described()
    text = _ascii(path, data)
    for several, dimension, iblank in product((True, False), (3, 2), (False, True)):
        found_text = _text_blocks(text, several, dimension, iblank)
        if found_text is not None:
            return found_text, "ascii"
    raise ReadError(path, f"its {len(data)} bytes fit no grid of Plot3D", DAMAGED)


def _forms(grid: bool):
    for order, real, records, several, dimension in product("<>", (8, 4), (True, False), (True, False), (3, 2)):
        for iblank in (False, True) if grid else (False,):
            yield _Form(order, real, records, several, dimension, iblank)


def _sections(data: bytes, form: _Form, size, extra: int = 0):
    """Shapes of the grids and the bytes of each, or None where the file does not fit the form to its last byte."""
    reader = _Records(data, form)
    head = reader.take(4) if form.several else np.array([1], f"{form.order}i4").tobytes()
    if head is None:
        return None
    count = int(np.frombuffer(head, f"{form.order}i4")[0])
    if not 0 < count <= GREATEST_GRID_COUNT:
        return None
    width = form.dimension + extra
    head = reader.take(4 * width * count)
    if head is None:
        return None
    sizes = np.frombuffer(head, f"{form.order}i4").reshape(count, width).astype(np.int64)
    if (sizes < 1).any() or (sizes.prod(axis=1, dtype=float) > len(data)).any():
        return None
    sections = []
    for row in sizes:
        nodes = int(row[: form.dimension].prod())
        part = reader.take(size(nodes * (int(row[-1]) if extra else 1), form))
        if part is None:
            return None
        sections.append(part)
    if not reader.at_end:
        return None
    shapes = [(*(int(n) for n in row[: form.dimension]), *([1] if form.dimension == 2 else [])) for row in sizes]
    return (shapes, sections) if not extra else ((shapes, [int(row[-1]) for row in sizes]), sections)


class _Records:
    """Bytes in Fortran's records, each between two counts of four bytes, or one after the other."""

    def __init__(self, data: bytes, form: _Form):
        self.data, self.form, self.at = data, form, 0

    def take(self, size: int) -> bytes | None:
        """The next record, which must be of a size; or the next bytes."""
        mark = 4 if self.form.records else 0
        begin = self.at + mark
        if begin + size + mark > len(self.data):
            return None
        if mark:
            counts = self.data[self.at : begin] + self.data[begin + size : begin + size + 4]
            if (np.frombuffer(counts, f"{self.form.order}u4") != size).any():
                return None
        self.at = begin + size + mark
        return self.data[begin : begin + size]

    @property
    def at_end(self) -> bool:
        """Whether no more follows than zeros, with which some systems fill up their last block."""
        rest = self.data[self.at :]
        return len(rest) < PADDING and not any(rest)


def _grid_block(section: bytes, shape, form: _Form) -> Block:
    nodes = int(np.prod(shape))
    values = np.frombuffer(section, f"{form.order}f{form.real}", form.dimension * nodes).reshape(form.dimension, nodes)
    blank = None
    if form.iblank:
        blank = np.frombuffer(section, f"{form.order}i4", nodes, form.dimension * nodes * form.real)
    return _block(values, shape, blank)


def _block(values: np.ndarray, shape, blank) -> Block:
    points = np.zeros((values.shape[1], 3))
    with np.errstate(invalid="ignore"):  # bytes that were never numbers are refused below
        points[:, : len(values)] = values.T
    hidden = None if blank is None or (blank != 0).all() else np.asarray(blank == 0)
    return Block(points, None, shape, blank=hidden)


def _plausible(block: Block) -> bool:
    """Whether coordinates can be some: bytes of another order or precision read as wild numbers."""
    size = np.abs(block.points[np.isfinite(block.points)])
    return bool(
        np.isfinite(block.points).all() and size.max(initial=0.0) < 1e12 and not 0 < size.max(initial=0.0) < 1e-20
    )


def _ascii(path: Path, data: bytes) -> np.ndarray:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(data.decode("ascii"), sep=" ")
        except (UnicodeDecodeError, DeprecationWarning, ValueError):
            raise ReadError(path, f"its {len(data)} bytes fit no form of Plot3D", DAMAGED) from None


def _text_shapes(text: np.ndarray, several: bool, width: int):
    count = int(text[0]) if several and len(text) and text[0] == int(text[0]) else 1
    begin = 1 if several else 0
    if not 0 < count <= GREATEST_GRID_COUNT or len(text) < begin + width * count:
        return None
    sizes = text[begin : begin + width * count]
    if (sizes != np.round(sizes)).any() or (sizes < 1).any():
        return None
    sizes = sizes.reshape(count, width)
    if (sizes.prod(axis=1) > len(text)).any():
        return None
    return sizes.astype(np.int64), begin + width * count


def _text_blocks(text: np.ndarray, several: bool, dimension: int, iblank: bool) -> list[Block] | None:
    head = _text_shapes(text, several, dimension)
    if head is None:
        return None
    sizes, at = head
    nodes = sizes.prod(axis=1)
    if at + int(nodes.sum()) * (dimension + iblank) != len(text):
        return None
    blocks = []
    for row, count in zip(sizes, nodes, strict=True):
        values = text[at : at + dimension * count].reshape(dimension, count)
        at += dimension * count
        blank = text[at : at + count] if iblank else None
        at += count if iblank else 0
        blocks.append(_block(values, (*(int(n) for n in row), *([1] if dimension == 2 else [])), blank))
    return blocks


def _read_solution(path: Path, shapes: list[tuple[int, int, int]]) -> list[dict[str, np.ndarray]]:
    data = path.read_bytes()
    for form in _forms(False):
        for single in (False, True):  # the four numbers before each grid's solution are a record of their own
            found = _solution(data, form, single)
            if found is not None:
                return _fitting(path, found[0], found[1], shapes)
        functions = _sections(data, form, lambda n, f: n * f.real, extra=1)
        if functions is not None:
            (own, counts), sections = functions
            values = [
                np.frombuffer(s, f"{form.order}f{form.real}").reshape(n, -1)
                for s, n in zip(sections, counts, strict=True)
            ]
            return _fitting(path, own, values, shapes, [f"f{k + 1}" for k in range(max(counts))])
    return _text_solution(path, _ascii(path, data), shapes)


def _solution(data: bytes, form: _Form, single: bool):
    reader = _Records(data, form)
    head = reader.take(4) if form.several else np.array([1], f"{form.order}i4").tobytes()
    count = 0 if head is None else int(np.frombuffer(head, f"{form.order}i4")[0])
    if not 0 < count <= GREATEST_GRID_COUNT:
        return None
    head = reader.take(4 * form.dimension * count)
    if head is None:
        return None
    sizes = np.frombuffer(head, f"{form.order}i4").reshape(count, form.dimension).astype(np.int64)
    if (sizes < 1).any() or (sizes.prod(axis=1, dtype=float) > len(data)).any():
        return None
    variables = form.dimension + 2
    values = []
    for row in sizes:
        nodes = int(row.prod())
        if single and form.records:
            part = reader.take((4 + variables * nodes) * form.real)
            part = None if part is None else part[4 * form.real :]
        elif reader.take(4 * form.real) is None:
            return None
        else:
            part = reader.take(variables * nodes * form.real)
        if part is None:
            return None
        values.append(np.frombuffer(part, f"{form.order}f{form.real}").reshape(variables, nodes))
    if not reader.at_end:
        return None
    return [(*(int(n) for n in row), *([1] if form.dimension == 2 else [])) for row in sizes], values


def _text_solution(path: Path, text: np.ndarray, shapes) -> list[dict[str, np.ndarray]]:
    for several, dimension in product((True, False), (3, 2)):
        head = _text_shapes(text, several, dimension)
        if head is None:
            continue
        sizes, at = head
        nodes, variables = sizes.prod(axis=1), dimension + 2
        if at + int(nodes.sum()) * variables + 4 * len(sizes) != len(text):
            continue
        values = []
        for count in nodes:
            values.append(text[at + 4 : at + 4 + variables * count].reshape(variables, count))
            at += 4 + variables * int(count)
        own = [(*(int(n) for n in row), *([1] if dimension == 2 else [])) for row in sizes]
        return _fitting(path, own, values, shapes)
    raise ReadError(path, f"its {len(text)} numbers fit no solution of Plot3D", DAMAGED)


def _fitting(path: Path, own, values, shapes, names=None) -> list[dict[str, np.ndarray]]:
    if list(own) != list(shapes):
        raise ReadError(
            path,
            f"the solution is of grids of {own} points, the grid of {shapes}",
            "give the pair that belongs together",
        )
    arrays = []
    for block in values:
        called = names or (CONSERVATIVE if len(block) == 5 else (*CONSERVATIVE[:3], "energy"))
        arrays.append({name: np.array(row, dtype=np.float64) for name, row in zip(called, block, strict=False)})
    return arrays
