"""What every trace promises however hard the scene, and the fields that several stress tests share."""

import numpy as np
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField
from aerokernels.tracing import RayStatus, TraceResult
from aerokernels.tracing.plan import RAY_OUTPUTS
from aerokernels.tracing.stop import reached

WAVE = 905e-9
UP = (0.0, 0.0, 1.0)
PRECISIONS = ("float32", "float64")
# Unit in the last place of 1, halved: the greatest relative error of one rounding.
UNIT = {"float32": 2.0**-24, "float64": 2.0**-53}
CELL = 1e-4


def keeps_promises(result: TraceResult, ray_count: int) -> TraceResult:
    """Check what no scene may break, and hand the result on.

    Every ray has one known status and the summary counts all of them; every array is there in full; a ray that arrived
    has no NaN and no infinite number in any output, a unit direction, a length and a path that are not negative. Boxes
    full of disturbed air make LEFT_DISTURBED_AIR of OK: such rays arrived all the same.
    """
    assert result.ray_count == ray_count
    assert set(np.unique(result.status)) <= {int(s) for s in RayStatus}
    assert sum(result.status_summary().values()) == ray_count
    assert np.array_equal(result.ok, reached(result.status))
    for name in RAY_OUTPUTS:
        array = getattr(result, name)
        assert len(array) == ray_count
        assert np.isfinite(array[result.ok]).all(), f"{name} of a ray with status OK is not finite"
    assert np.abs(np.linalg.norm(result.direction[result.ok], axis=1) - 1.0).max(initial=0.0) < 1e-14
    assert (result.arc_length[result.ok] >= 0.0).all()
    assert (result.optical_path[result.ok] >= 0.0).all()
    assert (result.step_error[result.ok] >= 0.0).all()
    return result


def assert_same_bits(first: TraceResult, second: TraceResult, rows_of_first=slice(None)) -> None:
    """Two results agree in every bit of every output (NaN counts as equal to NaN)."""
    assert np.array_equal(first.status[rows_of_first], second.status)
    for name in RAY_OUTPUTS:
        assert np.array_equal(getattr(first, name)[rows_of_first], getattr(second, name), equal_nan=True), name


def linear_square_field(gradient: float, cells: int = 16, length: float = 1.0, ambient: float = 1.0) -> IndexField:
    """n^2 = ambient^2 + gradient y over 0 <= y <= length, 0 <= z <= length: a constant force of gradient / 2.

    The potential is linear in y, so that every interpolant holds it to rounding and every ray is a parabola.
    """
    cell = length / cells
    excess = gradient * np.arange(cells + 1) * cell
    contrast = excess / (np.sqrt(ambient**2 + excess) + ambient)
    return IndexField.from_samples(
        np.repeat(contrast[:, None], cells + 1, axis=1),
        origin=(0.0, 0.0),
        spacing=(cell, cell),
        geometry="planar",
        ambient_index=ambient,
    )


def slab(
    contrast: float, geometry: str = "volume", cell: float = 1e-3, nodes: int = 5, ambient: float = 1.0
) -> IndexField:
    """A constant contrast in a box of (nodes - 1) cells a side: x, y about 0 (r from 0), z from 0."""
    dimension = 3 if geometry == "volume" else 2
    low = 0.0 if geometry == "axisymmetric" else -0.5 * (nodes - 1) * cell
    return IndexField.from_samples(
        np.full((nodes,) * dimension, contrast),
        origin=[low] * (dimension - 1) + [0.0],
        spacing=[cell] * dimension,
        geometry=geometry,
        ambient_index=ambient,
    )


def random_field(geometry: str, interpolation: str = "cubic", amplitude: float = 3e-4) -> IndexField:
    """Smooth noise of the given amplitude in a box of about 3 x 3 x 4 mm, cells of 0.1 mm."""
    low = 0.0 if geometry == "axisymmetric" else -14 * CELL
    shape = (31, 29, 41) if geometry == "volume" else (29, 41)
    origin = (-15 * CELL, low, 0.0) if geometry == "volume" else (low, 0.0)
    samples = gaussian_filter(np.random.default_rng(3).standard_normal(shape), 3, mode="nearest")
    return IndexField.from_samples(
        amplitude * samples / np.abs(samples).max(),
        origin=origin,
        spacing=(CELL,) * len(shape),
        geometry=geometry,
        ambient_index=1.0001,
        interpolation=interpolation,
    )
