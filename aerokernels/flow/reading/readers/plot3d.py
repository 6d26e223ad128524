"""Read Plot3D: a grid and its solution (q) or functions (f), binary of either kind and byte order, or ascii.

The file does not state its own form (Fortran records or plain bytes, byte order, precision, one grid or several, two or
three dimensions, iblank): only one interpretation fits to the last byte. A file that fits none is damaged.

    grid       [grids]  ni nj [nk] ...   x y [z] [iblank], i fastest
    q          [grids]  ni nj [nk] ...   mach alpha re time   rho rho_u rho_v [rho_w] e
    functions  [grids]  ni nj [nk] n ... f1 ... fn
    OVERFLOW   [grids]  ni nj nk ... n species   conditions of the run   rho rho_u rho_v rho_w e q6 ... qn
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import Block, Dataset, ReadError
from aerokernels.flow.reading.readers.point_table import fortran_numbers
from aerokernels.process.foreign_files import own_file

DAMAGED = "the file is damaged, or no file of Plot3D: write it again"
GRID_ENDS = (".xyz", ".x", ".g", ".p3d", ".grd", ".p2d")
SOLUTION_ENDS = (".q", ".f", ".fun", ".p3dq")
CONSERVATIVE = ("density", "momentum_x", "momentum_y", "momentum_z", "energy")


class _Stream:
    """The numbers of a file under one interpretation of its bytes or text, taken record by record."""

    def __init__(self, source: bytes | np.ndarray, order: str = "", real: int = 0, records: bool = False):
        """Interpret bytes by byte order and precision, in Fortran records or contiguous; or the numbers of a text."""
        self.source, self.order, self.real, self.records, self.at = source, order, real, records, 0

    def take(self, *parts: tuple[str, int]) -> list[np.ndarray] | None:
        """Return the next record of `parts`, counts of whole ("i") or real ("f") numbers; None if it does not match."""
        if not self.order:
            return self._take_text(parts)
        kinds = [np.dtype(f"{self.order}{kind}{4 if kind == 'i' else self.real}") for kind, _ in parts]
        ends = np.cumsum([0, *(kind.itemsize * count for kind, (_, count) in zip(kinds, parts, strict=True))]).tolist()
        mark = 4 if self.records else 0  # Fortran writes the byte count before and after a record
        begin, size = self.at + mark, ends[-1]
        if begin + size + mark > len(self.source):
            return None
        if mark:
            counts = self.source[self.at : begin] + self.source[begin + size : begin + size + 4]
            if (np.frombuffer(counts, f"{self.order}u4") != size).any():
                return None
        self.at = begin + size + mark
        each = zip(kinds, parts, ends[:-1], strict=True)
        return [np.frombuffer(self.source, kind, count, begin + end) for kind, (_, count), end in each]

    def _take_text(self, parts: tuple[tuple[str, int], ...]) -> list[np.ndarray] | None:
        ends = np.cumsum([count for _, count in parts])
        if self.at + ends[-1] > len(self.source):
            return None
        result = np.split(np.asarray(self.source[self.at : self.at + ends[-1]]), ends[:-1])
        if any(kind == "i" and (own != np.round(own)).any() for (kind, _), own in zip(parts, result, strict=True)):
            return None
        self.at += int(ends[-1])
        return result

    @property
    def at_end(self) -> bool:
        """Whether only zeros follow, with which some systems pad the last block."""
        remaining = self.source[self.at :]
        # Less than a disk or tape block, in bytes.
        return not len(remaining) if not self.order else len(remaining) < 1024 and not any(remaining)


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a grid with its solution; either may be named, the other is in the same folder or given as an option."""
    grid_path, solution_path = grid_and_solution(path, options.get("solution"))
    grids, form = _read_grid(grid_path)
    arrays = _read_solution(solution_path, [block.shape for block in grids if block.shape])
    blocks = [
        replace(block, point_data=own, name=f"grid {k}")
        for k, (block, own) in enumerate(zip(grids, arrays, strict=True), start=1)
    ]
    relative = "q files are mostly non-dimensional: without a reference their density is taken as kg/m3"
    scaled = relative if any("momentum_x" in own for own in arrays) else ""
    return Dataset(blocks, f"Plot3D, {form}", notes=[scaled] if scaled else [], scaled=scaled)


def files(path: Path, options: Mapping[str, Any], time: float | None) -> list[Path]:
    """Return the grid and the solution that `read` opens."""
    return list(grid_and_solution(path, options.get("solution")))


def grid_and_solution(path: Path, solution) -> tuple[Path, Path]:
    """Return the paths of grid and solution, of which one is given; errors as of `read`."""
    if solution is not None:
        return path, Path(solution)
    ends, others = (GRID_ENDS, SOLUTION_ENDS) if path.suffix.lower() in GRID_ENDS else (SOLUTION_ENDS, GRID_ENDS)
    beside = [other for other in sorted(path.parent.iterdir()) if other.suffix.lower() in others and other.is_file()]
    same = [other for other in beside if other.stem == path.stem] or beside
    if len(same) != 1:
        result = ", ".join(other.name for other in same) or "none"
        need = "solution" if ends is GRID_ENDS else "grid"
        raise ReadError(
            path, f"its {need} is not clear (beside it: {result})", f"name it: solution = PATH ({need} file)"
        )
    other = own_file(path, same[0].name)
    return (path, other) if ends is GRID_ENDS else (other, path)


def _meanings(path: Path, *more: tuple) -> Iterator[tuple]:
    """Yield the interpretations of a file: numbers, whether it has several grids, dimensions, and further choices."""
    data = path.read_bytes()
    for meaning in product("<>", (8, 4), (True, False)):
        for choice in product((True, False), (3, 2), *more):
            yield _Stream(data, *meaning), *choice
    try:
        text = fortran_numbers(data.decode("ascii"))
    except ValueError:
        raise ReadError(path, f"its {len(data)} bytes fit no form of Plot3D", DAMAGED) from None
    for choice in product((True, False), (3, 2), *more):
        yield _Stream(text), *choice


def _sizes(stream: _Stream, several: bool, width: int, more: int = 0) -> tuple[np.ndarray, list[int]] | None:
    """Return the sizes with which a file begins, a row for each grid, and `more` numbers; None if they cannot be."""
    stream.at, most = 0, len(stream.source)
    head = stream.take(("i", 1)) if several else [np.ones(1)]
    if head is None or not 0 < head[0][0] <= 100_000:
        return None
    result = stream.take(("i", width * int(head[0][0]) + more))
    if result is None or result[0].min() < 0 or result[0].max() > most:
        return None
    numbers = result[0].astype(np.int64)
    sizes = numbers[: len(numbers) - more].reshape(-1, width)
    if sizes.min() < 1 or (sizes.prod(axis=1, dtype=np.float64) > most).any():
        return None
    return sizes, numbers[len(numbers) - more :].tolist()


def _records(stream: _Stream, *wanted: Sequence[tuple[str, int]]) -> list[list[np.ndarray]] | None:
    """Return consecutive records; None if one does not match, or if the file goes on after them."""
    records = []
    for parts in wanted:
        if (record := stream.take(*parts)) is None:
            return None
        records.append(record)
    return records if stream.at_end else None


def _shapes(sizes: np.ndarray) -> list[tuple[int, int, int]]:
    return [(ni, nj, nk) for ni, nj, nk, *_ in ((*row, 1) for row in sizes.tolist())]


def _read_grid(path: Path) -> tuple[list[Block], str]:
    """Return the grids of a file, and its form in words."""
    for stream, several, dimension, iblank in _meanings(path, (False, True)):
        if (head := _sizes(stream, several, dimension)) is None:
            continue
        nodes = [math.prod(row) for row in head[0].tolist()]
        records = _records(stream, *((("f", dimension * n), ("i", n if iblank else 0)) for n in nodes))
        if records is None:
            continue
        blocks = []
        for (values, blank), shape in zip(records, _shapes(head[0]), strict=True):
            points = np.zeros((values.size // dimension, 3))
            with np.errstate(invalid="ignore"):  # of wrong interpretations
                points[:, :dimension] = values.reshape(dimension, -1).T
            hidden = blank == 0 if iblank and (blank == 0).any() else None
            blocks.append(Block(points, None, shape, blank=hidden))
        if not stream.order:
            return blocks, "ascii"
        greatest = [np.abs(block.points).max(initial=0.0) for block in blocks]
        # A wrong byte order or precision gives extreme coordinates.
        if all(own < 1e12 and not 0 < own < 1e-20 for own in greatest):
            kind = "Fortran records" if stream.records else "plain binary"
            return blocks, f"{kind}, {'little' if stream.order == '<' else 'big'} endian, float{8 * stream.real}"
    raise ReadError(path, f"its {path.stat().st_size} bytes fit no grid of Plot3D", DAMAGED)


def _read_solution(path: Path, shapes: list[tuple[int, int, int]]) -> list[dict[str, np.ndarray]]:
    for stream, several, dimension in _meanings(path):
        for form in (_conserved, _functions, _of_overflow):
            if (solution := form(stream, several, dimension)) is None:
                continue
            sizes, blocks, names = solution
            if _shapes(sizes) != list(shapes):
                fault = f"the solution is of grids of {_shapes(sizes)} points, the grid of {shapes}"
                raise ReadError(path, fault, "give the pair that belongs together")
            return [
                {name: np.array(row, np.float64) for name, row in zip(names, block, strict=False)} for block in blocks
            ]
    raise ReadError(path, f"its {path.stat().st_size} bytes fit no solution of Plot3D", DAMAGED)


def _conserved(stream: _Stream, several: bool, dimension: int):
    """Return the sizes of the grids, the variables of each and their names; None if the file is no q file."""
    width = dimension + 2
    for single in (False, True):  # the four numbers and the solution of a grid are one record or two
        if (head := _sizes(stream, several, dimension)) is None:
            return None
        parts = [[("f", 4), ("f", width * math.prod(row))] for row in head[0].tolist()]
        records = _records(stream, *(parts if single else [[part] for both in parts for part in both]))
        if records is not None:
            own = records if single else records[1::2]
            names = CONSERVATIVE if dimension == 3 else (*CONSERVATIVE[:3], "energy")
            return head[0], [record[-1].reshape(width, -1) for record in own], names
    return None


def _functions(stream: _Stream, several: bool, dimension: int):
    """Return the same of a function file."""
    if (head := _sizes(stream, several, dimension + 1)) is None:
        return None
    records = _records(stream, *([("f", math.prod(row))] for row in head[0].tolist()))
    if records is None:
        return None
    blocks = [own.reshape(row[-1], -1) for (own,), row in zip(records, head[0], strict=True)]
    return head[0][:, :-1], blocks, [f"f{k + 1}" for k in range(int(head[0][:, -1].max()))]


def _of_overflow(stream: _Stream, several: bool, dimension: int):
    """Return the same of a q file of OVERFLOW, whose grids have any number of variables."""
    head = _sizes(stream, several, 3, 2) if dimension == 3 else None
    if head is None or head[1][0] < len(CONSERVATIVE):
        return None
    sizes, (count, species) = head
    conditions = [("f", 7), ("i", 1), ("f", 6 + max(species, 2))]
    records = _records(
        stream, *(part for row in sizes.tolist() for part in (conditions, [("f", count * math.prod(row))]))
    )
    if records is None:
        return None
    names = (*CONSERVATIVE, *(f"q{k + 1}" for k in range(len(CONSERVATIVE), count)))
    return sizes, [record[-1].reshape(count, -1) for record in records[1::2]], names
