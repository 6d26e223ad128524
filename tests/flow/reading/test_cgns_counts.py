"""CGNS arrays whose counts do not fit zone, location and Rind: refused, or right by what the file states.

VTK's reader allocated by the zone's sizes and read what there was; the rest was memory that nobody wrote, which changed
from read to read.
"""

import itertools
import random

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


@pytest.mark.parametrize("location", [None, "Vertex", "CellCenter"])
@pytest.mark.parametrize("rind", [None, (0, 0, 0, 0), (1, 1, 1, 1), (2, 0, 0, 1)])
def test_what_fits_is_read(tmp_path, location, rind):
    """Expected: the values inside, without the ghosts that Rind states."""
    cells = location == "CellCenter"
    path = made(tmp_path / "a.cgns", density(cells, rind or (0, 0, 0, 0)), location, rind)
    assert np.array_equal(values_of(flow.read(path)), np.sort(density(cells).ravel()))


def damaged(random_one: random.Random):
    """A shape, a location and a Rind drawn each by itself, and whether they fit by the standard."""
    location = random_one.choice([None, "Vertex", "CellCenter"])
    stated = random_one.choice([None, None, (1, 1, 1, 1), (0, 1, 2, 0)])
    cells, held = location == "CellCenter", stated or (0, 0, 0, 0)
    if random_one.random() < 0.5:
        cells, held = not cells, random_one.choice([(0, 0, 0, 0), (1, 1, 1, 1), (0, 1, 2, 0)])
    values = density(cells, held)
    values = random_one.choice([values] * 5 + [values.T.copy(), values.ravel(), values[:, :-1], values[:-2]])
    wanted = density(location == "CellCenter", stated or (0, 0, 0, 0)).shape
    return values, location, stated, values.shape == wanted


def test_drawn_shapes_locations_and_rinds_are_right_or_refused_alike(tmp_path):
    """Set-up: 24 draws. Expected: in three reads each the same answer: the values inside, or the shapes in words."""
    right = 0
    for seed in range(24):
        values, location, rind, fits = damaged(random.Random(seed))
        path = made(tmp_path / f"{seed}.cgns", values, location, rind)
        answers = set()
        for _ in range(3):
            try:
                answers.add(values_of(flow.read(path)).tobytes())
            except ValueError as fault:
                answers.add(str(fault))
        (answer,) = answers
        if fits:
            low, left = (rind[2], rind[0]) if rind else (0, 0)
            rows, columns = (5, 8) if location == "CellCenter" else (6, 9)
            inner = values[low : low + rows, left : left + columns]
            assert answer == np.sort(inner.ravel()).tobytes(), seed
            right += 1
        else:
            assert "has the shape" in answer and f"{values.shape}" in answer, seed
    assert 3 < right < 21


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


def test_elements_arrays_and_types_that_do_not_fit(tmp_path):
    """Corners less than elements, an array without data, a list of places, a type that is not the data's."""
    for number, (change, told) in enumerate(
        (
            (lambda zone: shorten(zone["Elements 1/ElementConnectivity"]), "has 159 corners, elements 1 to 40 160"),
            (lambda zone: zone["Flow/Density"].pop(" data"), r"has the shape \(\), and Vertex"),
            (lambda zone: cgns_writer.node(zone["Flow"], "PointList", "IndexArray_t", [[1]]), "at a list of places"),
            (lambda zone: zone["Flow/Density"].attrs.modify("type", np.bytes_("R4")), "is of float64, and .* 'R4'"),
        )
    ):
        path = made(tmp_path / f"{number}.cgns", np.ones(54), None, None, elements=True)
        with h5py.File(path, "r+") as file:
            change(file["Base/Zone"])
        with pytest.raises(ValueError, match=told):
            flow.read(path)


def shorten(array) -> None:
    kept = array[" data"][:-1]
    del array[" data"]
    array[" data"] = kept


@pytest.mark.parametrize(("least", "cells"), [*itertools.product([9.9e-7, 5e-324], [False, True])])
def test_densities_that_no_gas_has(tmp_path, least, cells):
    """Expected: below 1e-6 kg/m3 a density is refused; 1e-6 kg/m3 itself is read."""
    values = density(cells)
    for value, good in ((least, False), (1e-6, True)):
        values[2, 3] = value
        path = made(tmp_path / "a.cgns", values, "CellCenter" if cells else None, None)
        if good:
            assert flow.read(path).density.min() == 1e-6
        else:
            with pytest.raises(ValueError, match=r"1 of \d+ densities from Density are too small for a gas, below"):
                flow.read(path)
