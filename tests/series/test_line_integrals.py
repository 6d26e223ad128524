"""Straight lines through volumes: sums over a sheared lattice, and what bending adds to them."""

import numpy as np
import pytest

from aerokernels import Disc, flow, optical_series
from aerokernels.flow import GridMesh
from aerokernels.medium.spline import node_values
from aerokernels.series import line_integrals
from aerokernels.series.line_integrals import LineIntegrals

from .fourier import CONSTANT, Fourier

SPACING, ORIGIN = 2.5e-3, np.array([-0.05, -0.05, 0.0])
X, Y = (one.ravel() for one in np.meshgrid(np.linspace(-0.02, 0.02, 12), np.linspace(-0.018, 0.021, 13)))


def slanted(shape, direction) -> tuple[GridMesh, np.ndarray, np.ndarray]:
    """A grid, rays from ahead of it that pass through its middle, and their direction."""
    along = np.array(direction) / np.linalg.norm(direction)
    middle = ORIGIN + 0.5 * SPACING * (np.array(shape) - 1)
    back = middle - 0.2 * along
    start = back + np.stack([X, Y, np.zeros_like(X)], axis=1)
    return GridMesh("volume", ORIGIN, [SPACING] * 3, shape), start, along


def exact(field: Fourier, mesh: GridMesh, lines: LineIntegrals) -> np.ndarray:
    """The closed form from where each ray enters the box, over the length of it there [kg/m2]."""
    axis, along = lines.axis, lines.direction
    face = mesh.box[0 if along[axis] > 0.0 else 1][axis]
    entry = lines.start + ((face - lines.start[:, axis]) / along[axis])[:, None] * along
    return field.opd(entry, along, lines.length, 0.0) / CONSTANT


@pytest.mark.parametrize("direction", [(0.3, 0.15, 1.0), (0.2, 1.0, -0.3)])
def test_sums_over_a_sheared_lattice_are_the_integrals(direction, monkeypatch: pytest.MonkeyPatch):
    """Set-up: 12 modes of 60 rad/m, nodes 2.5 mm apart, rays across two axes, through x, y and z.

    Expected: the closed form. Error: the spline's along and across the axis, twice across it: (k h)^4 of 0.15^4, at
    most 5e-4 of the rms; that of the matrix of the same lines is as large but for a factor of four.
    """
    monkeypatch.setattr(line_integrals, "MOST_ENTRIES", 0)
    field = Fourier.random(1)
    field.mean = 0.0
    mesh, start, along = slanted((33, 31, 29), direction)
    samples = field.on_grid(ORIGIN, SPACING, mesh.shape, 0.0, np.float32)
    lines = LineIntegrals(mesh, start, along)
    truth = exact(field, mesh, lines)
    good = lines.inside
    assert good.sum() > 100 and lines.lattice is not None
    found = lines(samples)
    rms = np.sqrt(np.mean(truth[good] ** 2))
    assert np.abs(found - truth)[good].max() < 5e-4 * rms
    assert (found[~good] == 0.0).all()


@pytest.mark.parametrize(
    ("geometry", "direction"),
    [("volume", (0, 0, 1)), ("axisymmetric", (0, 0.2, 1)), ("volume", (1, 0.1, 0.2)), ("volume", (0.1, -1, 0))],
)
def test_averages_over_cells_are_made_values_at_the_nodes(geometry: str, direction):
    """Along an axis and at a slant; the integrals of `node_values` of all of the samples."""
    rng, along = np.random.default_rng(4), np.array(direction) / np.linalg.norm(direction)
    if geometry == "axisymmetric" and abs(along[2]) < 0.8:
        return
    shape = (14, 13, 12) if geometry == "volume" else (14, 13)
    samples = rng.normal(size=shape)
    meshes = [GridMesh(geometry, [0.0] * len(shape), [0.1] * len(shape), shape, averages) for averages in (True, False)]
    start = rng.uniform(0.4, 0.8, (50, 3)) - 1.4 * along * (geometry == "volume")
    both = [LineIntegrals(mesh, start, along) for mesh in meshes]
    nodes = node_values(samples, "cubic", geometry == "axisymmetric")
    np.testing.assert_allclose(both[0](samples), both[1](nodes), atol=1e-12)


def test_the_speed_script_finds_errors_that_are_reported():
    """A small run of scripts/series_speed. Expected: nearest-neighbour sums 30 times worse, the error below `error`."""
    from scripts.series_speed import COLUMNS, measure_series, table_rows

    found = measure_series((45, 45, 31), 24, 4)
    for one in found:
        assert 30.0 * one["error_m"] < one["nearest_m"] and one["error_m"] < one["reported_m"] and not one["traced"]
    assert [len(row) for row in table_rows(found)] == [len(COLUMNS)] * 3


def test_a_gpu_that_is_not_there_is_refused():
    import warp

    if warp.is_cuda_available():
        pytest.skip("there is one")
    field = Fourier.random(2)
    options = {"geometry": "volume", "origin": ORIGIN, "spacing": [SPACING] * 3, "ambient_density": field.mean}
    series = flow.open_series([field.on_grid(ORIGIN, SPACING, (9, 9, 9), 0.0)], time=[0.0], **options)
    with pytest.raises(ValueError, match="cuda:0"):
        optical_series(series, Disc(0.005, [-0.04, -0.04, -0.01]), device="cuda:0")
