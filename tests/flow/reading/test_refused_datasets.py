"""What is refused of points, cells and arrays whatever format they came in; what cells of other kinds make."""

import numpy as np
import pytest
import writers

from aerokernels import DensityField, flow
from aerokernels.flow.reading.dataset import (
    HEXAHEDRON,
    QUAD,
    Block,
    Cells,
    ReadError,
)
from aerokernels.flow.reading.frame import Frame

# Four quadrilaterals of a plane x-y, and eight hexahedra.
AXIS = np.linspace(0.0, 1.0, 3)
FLAT = np.stack([*(a.ravel() for a in np.meshgrid(AXIS, AXIS)), np.zeros(9)], axis=1)
QUADS = np.array([(0, 1, 4, 3), (1, 2, 5, 4), (3, 4, 7, 6), (4, 5, 8, 7)])
SOLID = np.stack([a.ravel() for a in np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")[::-1]], axis=1)
INDEX = np.arange(27).reshape(3, 3, 3)
ORDER = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
BRICKS = np.stack([INDEX[a : 2 + a, b : 2 + b, c : 2 + c].ravel() for a, b, c in ORDER], axis=1)


def flat(**changes) -> Block:
    return Block(
        **{"points": FLAT, "cells": Cells.of_one_type(QUAD, QUADS), "point_data": {"rho": np.ones(9)}, **changes}
    )


def solid(kind: int = HEXAHEDRON, corners=BRICKS, **changes) -> Block:
    cells = Cells.of_one_type(kind, corners)
    return Block(**{"points": SOLID, "cells": cells, "point_data": {"rho": np.ones(27)}, **changes})


def read(*blocks: Block, **options):
    return writers.field(list(blocks), **options)


BAD_COUNTS = Cells(np.full(4, QUAD, np.uint8), np.array([0, 4, 8, 12]), QUADS.ravel())


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (lambda: read(), "it has no points"),
        (lambda: read(flat(cells=None, shape=(3, 4, 1))), r"a grid of \(3, 4, 1\) points has 9"),
        (lambda: read(flat(cells=BAD_COUNTS)), "do not agree with their own counts"),
        (lambda: read(flat(cells=Cells.of_one_type(QUAD, QUADS + 1))), "cell 3 has corners beyond the 9 points"),
        (lambda: read(flat(), geometry="volume"), "its points are in a plane: it is not a volume"),
        (lambda: read(solid(), geometry="axisymmetric"), "its points fill a volume, it is not axisymmetric"),
        (lambda: read(flat(cells=None)), "has points and no cells"),
        (lambda: read(flat(cells=Cells.of_one_type(3, QUADS[:, :2]))), "has no triangles, quadrilaterals or pol"),
        (lambda: read(solid(3, BRICKS[:, :2])), "it has no solid cells"),
        (lambda: read(solid(corners=BRICKS[:, [0, 1, 2, 3, 0, 1, 2, 3]])), "have no volume"),
        (lambda: read(flat(point_data={"rho": np.ones((9, 2))})), r"array 'rho' has shape \(9, 2\) for 9 points"),
        (lambda: read(flat(point_data={"p": np.ones(9)}, cell_data={"T": np.ones(4)}),
                      density={"pressure": "p", "temperature": "T"}), "p and T are given at different places"),
        (lambda: read(flat(cell_data={"N2": np.ones(4)}), density="rho", species=["N2"]),
         "N2 is given at cells, the density at points"),
        (lambda: read(flat(), species=True), "no array is called by a species"),
        (lambda: read(flat(), flat(point_data={}, cell_data={"rho": np.ones(4)})), "some blocks have their values in"),
    ],
)  # fmt: skip
def test_datasets(given, told):
    with pytest.raises(ReadError, match=told) as refused:
        given()
    assert "FILE" in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("given", "fault", "told"),
    [
        (lambda: read(solid(), region=[(2, 2, 2), (3, 3, 3)]), ValueError, "is outside the flow of FILE"),
        (lambda: read(solid(), spacing=-0.1), ValueError, r"spacing must be positive, got -0\.1"),
        (lambda: read(solid(), spacing=1e-4), ValueError, "asks for 1e.12 nodes, more than"),
        (lambda: read(flat(), density={"pressure": "p"}), ValueError, "a mapping of 'pressure' and 'temperature'"),
        (lambda: read(flat(), species={"N2": 1.0}), TypeError, "N2 must name an array of the file, got 1.0"),
        (lambda: read(flat(), species=3), TypeError, "species must be True, formulas"),
        (lambda: Frame(origin=(0.0, 1.0)), ValueError, "origin must be three finite coordinates"),
        (lambda: Frame.of(3), TypeError, "frame must be a Frame, a mapping or an optical axis"),
        (lambda: Frame(optical=(0.0, 0.0, 0.0)), ValueError, "must be an axis such as '-x' or three numbers"),
        (lambda: read(flat(), frame={"up": "x"}), ValueError, "up 'x' needs an optical axis beside it"),
        (lambda: flow.read(np.ones(3)), TypeError, "for arrays there are DensityField.from_xarray"),
    ],
)
def test_arguments(given, fault, told):
    with pytest.raises(fault, match=told):
        given()


@pytest.mark.parametrize("turn", [0.3, 1.2])
@pytest.mark.parametrize("density", [lambda p: 1.0 + 0.2 * p[:, 0], lambda p: 1.0 + 0.3 * p[:, 1]])
def test_a_plane_askew_in_the_file(turn, density):
    """A plane turned about the file's y axis. Expected: its density where `frame` puts it, to 1e-12."""
    c, s = np.cos(turn), np.sin(turn)
    points = FLAT @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    field = read(flat(points=points, point_data={"rho": density(FLAT)}))
    axes = Frame().axes(np.array([-s, 0.0, c]))
    where = points[4] + 0.3 * (points[5] - points[4]) + 0.1 * (points[7] - points[4])
    at = FLAT[4:5] + 0.3 * (FLAT[5] - FLAT[4]) + 0.1 * (FLAT[7] - FLAT[4])
    assert field.density_at((axes @ where)[None]) == pytest.approx(density(at), rel=1e-12)


def test_hidden_points_of_a_plane_take_their_cells_along():
    blank = np.zeros(9, bool)
    blank[0] = True
    assert len(read(flat(blank=blank)).mesh.cells) == 3
    assert len(read(flat(blank=blank, cells=None, shape=(3, 3, 1))).mesh.cells) == 3


@pytest.mark.parametrize("in_time", [False, True])
def test_an_attribute_of_the_ambient_density_is_of_kg_m3_or_has_its_unit(in_time):
    import xarray

    places = np.linspace(0.0, 0.01, 5)
    values = np.full((5, 5), 1.25e-3)
    values[2] = 1.1e-3

    def ambient(stated):
        attributes = {"units": "g/cm3", "ambient_density": stated}
        array = xarray.DataArray(values, {"y": places, "z": places}, ("y", "z"), "rho", attributes)
        if in_time:
            array = array.expand_dims(time=[0.0, 1.0]).assign_attrs(attributes)
            return flow.open_series(array).ambient_density
        return DensityField.from_xarray(array).ambient_density

    assert ambient(1.2) == ambient("1.2e-3 g/cm3") == 1.2
    with pytest.raises(ValueError, match=r"ambient_density = 0.0012 is in kg/m3, .* write 1.2 "):
        ambient(1.2e-3)


@pytest.mark.parametrize("where", ["point", "cell"])
def test_an_array_iblank_blanks_in_any_format(where):
    """Set-up: an array IBlank, 0 at the middle one of 5 x 5 points or cells, where the density is 0.

    Expected: no flow there. Formats other than Plot3D and Tecplot took its numbers for a density.
    """
    count = 5 if where == "point" else 6
    y, x = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(float)
    held = (np.arange(25) != 12).astype(float)
    data = {"rho": 1.2 * held, "IBlank": held.astype(np.int32)}
    block = Block(points, None, (count, count, 1), **{f"{where}_data": data})
    field = read(block)
    assert len(field.mesh.cells) == (12 if where == "point" else 24) and field.body is not None
    assert field.density.min() == pytest.approx(1.2)
    del data["IBlank"]
    with pytest.raises(ReadError, match="where there is no flow, say so by an array iblank that is 0 there"):
        read(block)


def test_a_density_of_some_zones_only_is_named(tmp_path):
    """Expected: which arrays are not in every zone; "there are: none" was said of a file that shows a density."""
    points = np.array([[x, y, 0.0] for y in range(3) for x in range(3)], float)
    blocks = [Block(points + shift, None, (3, 3, 1), {name: np.ones(9)}) for shift, name in ((0.0, "rho"), (2.0, "p"))]
    with pytest.raises(ReadError, match=r"there are: none; in some zones only: rho, p\)"):
        read(*blocks)
