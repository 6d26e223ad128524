"""Files of Tecplot as its own programs write them: zones that share variables, times, records of words; refusals."""

import struct

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.formats import load

X, Y, RHO = np.tile([0.0, 1.0, 2.0], 2), np.repeat([0.0, 1.0], 3), np.array([1.0, 1.5, 2.0, 1.25, 1.75, 2.25])
QUADS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])


def whole(*numbers: int) -> bytes:
    return np.array(numbers, "<i4").tobytes()


def text(word: str) -> bytes:
    return whole(*map(ord, word), 0)


def real(number: float, form: str = "<f") -> bytes:
    return struct.pack(form, number)


def head(name: str = "one", time: float = 0.0, kind: int = 3, count: int = 6, strand: int = -1) -> bytes:
    """A zone's part of the header: two quadrilaterals, or 3 x 2 nodes in order, with a text of its own."""
    size = whole(count, 2, 0, 0, 0) if kind else whole(3, 2, 1)
    return real(299.0) + text(name) + whole(-1, strand) + real(time, "<d") + whole(-1, kind, 0, 0, 0) + size + (
        whole(1) + text("Common.Gas") + whole(0) + text("air") + whole(0)
    )  # fmt: skip


def data(arrays, passive=(0, 0, 0), shared=(-1, -1, -1), cells: int = -1, corners=QUADS) -> bytes:
    """A zone's data: the arrays that are its own, and its elements unless it has another zone's."""
    body = real(299.0) + whole(2, 2, 2)
    body += whole(1, *passive) if any(passive) else whole(0)
    body += whole(1, *shared) if max(shared) >= 0 else whole(0)
    body += whole(cells) + b"".join(np.array([a.min(), a.max()], "<f8").tobytes() for a in arrays)
    body += b"".join(np.asarray(a, "<f8").tobytes() for a in arrays)
    return body + (b"" if corners is None or cells >= 0 else corners.astype("<i4").tobytes())


def written(
    path, heads, bodies, *, count: int = 3, begin: bytes = b"#!TDV112", kind: int = 0, order: int = 1, more: bytes = b""
):
    names = b"".join(map(text, ("X", "Y", "rho")))
    told = text("gas") + whole(0) + text("air")
    path.write_bytes(
        begin + whole(order, kind) + text("t") + whole(count) + names + real(799.0) + told + b"".join(heads)
        + more + real(357.0) + b"".join(bodies)
    )  # fmt: skip
    return path


def test_a_later_time_has_its_mesh_from_the_first(tmp_path):
    """Two times, the second with points and elements of the first. Expected: its own density on that mesh, exactly."""
    path = written(
        tmp_path / "a.plt",
        [head("one", 0.5), head("two", 1.5)],
        [data([X, Y, RHO]), data([2.0 * RHO], shared=(0, 0, -1), cells=0)],
    )
    for time, factor in ((0.5, 1.0), (1.5, 2.0), (None, 2.0)):
        field = flow.read(path, time=time)
        assert field.density_at([[0.0, 0.5, -1.0]]) == pytest.approx(factor * 1.625, rel=1e-14)
    assert flow.contents(path).times == (0.5, 1.5)


@pytest.mark.parametrize(
    ("heads", "bodies", "how", "told"),
    [
        ([head()], [data([X, Y, RHO])], {"begin": b"#!TDX112"}, r"it does not begin with #!TDV"),
        ([head()], [data([X, Y, RHO])], {"order": 7}, "its byte order is invalid"),
        ([head()], [data([X, Y, RHO])], {"kind": 1}, "it contains only a grid or only a solution"),
        ([head().replace(whole(-1, 3, 0, 0, 0), whole(-1, 3, 0, 1, 0))], [], {}, "lists the neighbours of its faces"),
        ([head()], [data([Y, RHO], shared=(5, -1, -1))], {}, "shares with a zone that is not there"),
        ([head(), head("two", count=4)], [data([X, Y, RHO]), data([Y[:4], RHO[:4]], shared=(0, -1, -1))], {},
         "zone 'two' shares a variable of another size"),
        ([head()], [data([X, Y, RHO], corners=QUADS + 1)], {}, "refer to nodes beyond the 6"),
        ([head()], [data([X, Y, RHO]) + b"more"], {}, "more follows the last zone"),
        ([head()], [data([X, Y, RHO])], {"more": real(499.0)}, "a text is drawn in it: write it again without texts"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(tmp_path, heads, bodies, how, told):
    path = tmp_path / "a.plt"
    with pytest.raises(ReadError, match=told) as refused:
        load(written(path, heads, bodies, **how), None, {})
    assert str(path) in str(refused.value)


def test_zones_of_the_static_strand_belong_to_every_time(tmp_path):
    """A zone beside one that changes in time. Expected: the box of both and two times, in either form of the file."""
    heads = [head("still"), head("first", 0.5, strand=0), head("last", 1.5, strand=0)]
    path = written(tmp_path / "a.plt", heads, [data([X, Y + k, RHO]) for k in (0.0, 1.0, 1.0)])
    lines = ["VARIABLES = X Y rho"]
    for strand, time, above in ((0, 0.0, 0.0), (1, 0.5, 1.0), (1, 1.5, 1.0)):
        lines += [f"ZONE I=3, J=2, STRANDID={strand}, SOLUTIONTIME={time}, F=POINT"]
        lines += [f"{x} {y + above} {rho}" for x, y, rho in zip(X, Y, RHO, strict=True)]
    plain = tmp_path / "a.dat"
    plain.write_text("\n".join(lines))
    for file in (path, plain):
        assert flow.contents(file).times == (0.5, 1.5)
        for time in (0.5, 1.5):
            np.testing.assert_array_equal(flow.read(file, time=time).box, [[0.0, -2.0], [2.0, 0.0]])


def test_texts_of_tecplot_have_names_of_every_language_and_exponents_of_fortran(tmp_path):
    """Expected: the names as they are, with Fortran's exponents without a letter, and the unit of length."""
    lines = ['TITLE = "Düse"', 'VARIABLES = "X [mm]" "Y [mm]" "ρ" "µ"', "ZONE I=3, J=2, F=POINT"]
    lines += [f"{x} {y} {rho} 1.5-101" for x, y, rho in zip(X, Y, RHO, strict=True)]
    path = tmp_path / "a.dat"
    for encoding in ("utf-8-sig", "utf-8"):
        path.write_text("\n".join(lines), encoding=encoding)
        (block,) = load(path, None, {}).blocks
        assert list(block.point_data) == ["ρ", "µ"] and block.point_data["µ"].tolist() == [1.5e-101] * 6
        assert flow.read(path, density="ρ").density_at([[0.0, 0.5e-3, -1e-3]]) == pytest.approx(1.625, rel=1e-14)
    path.write_text("\n".join(lines).replace("ρ", "Größe"), encoding="latin-1")
    assert list(load(path, None, {}).blocks[0].point_data) == ["Größe", "µ"]


def ascii_times(share: str, cells: str = ", CONNECTIVITYSHAREZONE=1", packing: str = "BLOCK") -> str:
    """Two times in text, the second with X and Y of the first, by `share`, and with its elements."""
    lines = ["VARIABLES = X Y rho"]
    quads = "\n".join(" ".join(str(k + 1) for k in row) for row in QUADS)
    for time, columns, more in ((0, [X, Y, RHO], ""), (1, [2.0 * RHO], f", VARSHARELIST={share}{cells}")):
        columns = columns if packing == "BLOCK" else np.stack(columns, axis=1)
        lines.append(f"ZONE N=6, E=2, ZONETYPE=FEQUADRILATERAL, DATAPACKING={packing}, SOLUTIONTIME={time}{more}")
        lines += [" ".join(map(str, row)) for row in columns]
        lines += [quads] if not (more and cells) else []
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("packing", "share", "cells"),
    [
        ("BLOCK", "([1-2]=1)", ""),
        ("POINT", "([1, 2])", ", CONNECTIVITYSHAREZONE=1"),
        ("BLOCK", "([1]=1,[2]=1)", ", CONNECTIVITYSHAREZONE=1"),
    ],
)
def test_zones_in_text_share_variables_and_elements(tmp_path, share, cells, packing):
    """Expected: the second time's own density on the mesh of the first. Such files were refused."""
    (tmp_path / "a.dat").write_text(ascii_times(share, cells, packing))
    for time, factor in ((0, 1.0), (1, 2.0)):
        field = flow.read(tmp_path / "a.dat", time=time)
        assert np.sort(field.density.ravel()) == pytest.approx(np.sort(factor * RHO))
