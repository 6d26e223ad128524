"""CGNS arrays whose counts do not fit zone, location and Rind: refused, or right by what the file states.

VTK's reader allocated by the zone's sizes and read what there was; the rest was memory that nobody wrote, which changed
from read to read.
"""

import numpy as np
import pytest

from aerokernels import flow

from . import cgns_writer, writers

h5py = pytest.importorskip("h5py")
pytest.importorskip("vtkmodules")

X_AXIS, Y_AXIS = np.linspace(0.0, 2.0, 9), np.linspace(0.0, 1.0, 6)
X, Y = np.meshgrid(X_AXIS, Y_AXIS)
GHOST = 77.0


def centres(axis):
    return 0.5 * (axis[1:] + axis[:-1])


def density(cells: bool, rind=(0, 0, 0, 0)) -> np.ndarray:
    """1 + 0.1 y + 0.01 x at vertices or centres of cells, in ghosts 77: array [j, i]."""
    x, y = (centres(X_AXIS), centres(Y_AXIS)) if cells else (X_AXIS, Y_AXIS)
    inner = 1.0 + 0.1 * y[:, None] + 0.01 * x
    return np.pad(inner, (rind[2:], rind[:2]), constant_values=GHOST)


def made(path, values, location, rind, *, elements: bool = False, sizes=None):
    """A plane zone with a solution as stated; None states nothing."""
    axes, sections = (X, Y), None
    if elements:
        axes, sections = (X.ravel(), Y.ravel()), [(7, writers.quads(9, 6))]
    cgns_writer.cgns(path, axes, values, [], elements=sections)
    with h5py.File(path, "r+", track_order=True) as file:
        solution = file["Base/Zone/Flow"]
        if location is not None:
            cgns_writer.node(solution, "GridLocation", "GridLocation_t", location)
        if rind is not None:
            cgns_writer.node(solution, "Rind", "Rind_t", rind)
        if sizes is not None:
            file["Base/Zone/ data"][...] = sizes
    return path


def values_of(field) -> np.ndarray:
    """Densities in an order that is the same in each frame."""
    return np.sort(field.density.ravel())


@pytest.mark.parametrize(
    ("location", "rind"),
    [(None, None), ("Vertex", (1, 1, 1, 1)), ("CellCenter", (2, 0, 0, 1)), ("CellCenter", None), (None, (2, 0, 0, 1))],
)
def test_what_fits_is_read(tmp_path, location, rind):
    """Expected: the values inside, without the ghosts that Rind states."""
    cells = location == "CellCenter"
    path = made(tmp_path / "a.cgns", density(cells, rind or (0, 0, 0, 0)), location, rind)
    assert np.array_equal(values_of(flow.read(path)), np.sort(density(cells).ravel()))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"location": "IFaceCenter"}, "is at IFaceCenter: write it at Vertex or CellCenter"),
        ({"rind": (-1, 0, 0, 0)}, r"has the Rind \[-1, 0, 0, 0\]"),
        ({"rind": (1, 1)}, "has no 4 whole numbers"),
        ({"sizes": [[9, 6], [9, 6], [0, 0]]}, "states the sizes"),
        ({"sizes": [[10, 6], [9, 5], [0, 0]]}, r"CoordinateX in GridCoordinates .* shape \(6, 9\), .* is \(6, 10\)"),
        ({"elements": True, "values": (40,)}, r"has the shape \(40,\), and Vertex with the zone's sizes is \(54,\)"),
        ({"elements": True, "location": "CellCenter"}, r"shape \(54,\), and CellCenter .* is \(40,\)"),
        ({"elements": True, "rind": (1, 1), "values": (56,)}, "write the zone without its ghosts"),
        ({"elements": True, "sizes": [[54], [41], [0]]}, "states 41 cells, and its elements are 40"),
    ],
)
def test_other_sizes_that_do_not_fit(tmp_path, options, told):
    options = {"location": None, "rind": None, **options}
    values = np.ones(options.pop("values", (54,) if options.get("elements") else (6, 9)))
    with pytest.raises(ValueError, match=rf"a\.cgns: .*{told}"):
        flow.read(made(tmp_path / "a.cgns", values, **options))
