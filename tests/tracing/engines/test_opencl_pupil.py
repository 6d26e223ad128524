"""The million-ray pupil's OpenCL kernels against NumPy."""

import numpy as np
import pytest

from aerokernels import Annulus, Mask, Polygon
from aerokernels.pupils.square_map import RING, SquareMap
from aerokernels.tracing.pupil.run import check_memory
from aerokernels.tracing.scheme import GROUP, REDUCTION_WIDTH
from aerokernels.tracing.stop import RayStatus
from aerokernels.tracing.tasks.quadrature import LATTICES, lattice_points, smoothed_axes
from aerokernels.tracing.tasks.sums import MOMENT_COUNT, SUM_COUNT

from ..opencl_stands import need_opencl

GUARD = -7.0  # what lies behind the end of each array, and has to stay there


class Device:
    """A device with the pupil's kernels; arrays go there with a guard of 64 rows behind their end."""

    def __init__(self):
        need_opencl()
        import pyopencl.array

        from aerokernels.tracing.engines.opencl.devices import session

        self.opened = session()
        self.arrays = pyopencl.array

    def put(self, values: np.ndarray):
        rows = np.full((64, *values.shape[1:]), GUARD).astype(values.dtype)
        return self.arrays.to_device(self.opened.queue, np.concatenate([values, rows]))

    def get(self, array) -> np.ndarray:
        values = array.get()
        assert (values[-64:] == np.array(GUARD).astype(values.dtype)).all(), "written behind the end"
        return values[:-64]

    def run(self, name: str, items: int, *arguments) -> None:
        from aerokernels.tracing.engines.opencl.program import build
        from aerokernels.tracing.engines.opencl.session import WORK_GROUP, Kernel

        kernel = Kernel(self.opened, build(self.opened, "pupil.cl"), name)
        given = [a.data if hasattr(a, "data") else a for a in arguments]
        kernel.kernel(self.opened.queue, kernel.size(items), (WORK_GROUP,), *given).wait()


def double3(vector):
    """A vector by value."""
    from pyopencl.cltypes import make_double3

    return make_double3(*vector)


@pytest.fixture(scope="module")
def device() -> Device:
    return Device()


def rays(count: int) -> dict[str, np.ndarray]:
    """A wavefront of `count` rays, a tenth of which did not arrive and carry NaN."""
    rng = np.random.default_rng(count)
    status = np.where(rng.random(count) < 0.1, int(RayStatus.HIT_BODY), int(RayStatus.OK)).astype(np.int32)
    lost = status != RayStatus.OK
    return {
        "pupil": rng.uniform(-1.0, 1.0, (count, 2)),
        "opd": np.where(lost, np.nan, 2e-7 + 1e-7 * rng.normal(size=count)),
        "step_error": np.where(lost, np.nan, 1e-9 * rng.random(count)),
        "evaluation_count": rng.integers(1, 99, count).astype(np.int32),
        "status": status,
    }


SHAPES = {
    "annulus": Annulus(1.0, 0.3),
    "mask": Mask([[0.0, 1.0, 2.5], [3.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.2, 0.1, 0.0]], 0.5),
    "polygon": Polygon([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [1.0, 0.5], [0.0, 2.0]]),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_points_are_those_of_their_map(device: Device, shape: str):
    """Three replicates of 333 points, launched in two parts: NumPy's places of the same points of the unit square."""
    per, count = 333, 999
    vectors = np.random.default_rng(1).normal(size=(6, 3))
    across = np.linalg.inv(vectors[4:, :2]).T  # undoes the matrix by which coordinates are made
    seeds = np.random.default_rng(2).integers(0, 2**32, (3, 2), dtype=np.uint32)
    order = np.random.default_rng(3).permutation(per).astype(np.int32)
    out = [device.put(np.zeros((count, width))) for width in (3, 3, 2, 1)]
    of_square = SHAPES[shape].square_map
    numbers_of_shape = of_square.shape, of_square.row_count, of_square.column_count
    table = device.put(of_square.table)
    for first, stop in ((0, 500), (500, count)):
        numbers = [double3(v) for v in vectors]
        # Padded to whole work-groups, the last of them beyond the end.
        ends = *(np.int32(number) for number in (per, 0, 0)), np.int32(first), np.int32(stop)
        of_shape = *(np.int32(number) for number in numbers_of_shape), table
        device.run("launch_pupil", stop - first, *numbers, *of_shape, device.put(seeds), device.put(order), *ends, *out)
    place = device.get(out[2]) @ across
    # The same points again by NumPy: those of the unit square from the disc's places, without a shape of their own.
    ring = SquareMap(RING, 0, 0, np.zeros(1))
    plain = device.put(np.zeros((count, 2)))
    of_ring = np.int32(RING), np.int32(0), np.int32(0), device.put(ring.table)
    ends = *(np.int32(number) for number in (per, 0, 0, 0)), np.int32(count)
    given = [*numbers, *of_ring, device.put(seeds), device.put(order), *ends, *out[:2], plain, out[3]]
    device.run("launch_pupil", count, *given)
    x, y = (device.get(plain) @ across).T
    square = np.stack([x * x + y * y, np.arctan2(y, x) / (2.0 * np.pi) % 1.0], axis=1)
    assert np.abs(of_square.points(square) - place).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_points_of_a_lattice_are_those_of_numpy(device: Device, shape: str):
    """Three replicates of 144 points: places and weights as lattice_points has them, to some roundings."""
    per, count = 144, 432
    vectors = np.concatenate([np.eye(4, 3), np.eye(2, 3)])
    seeds = np.random.default_rng(2).integers(0, 2**32, (3, 2), dtype=np.uint32)
    order = np.random.default_rng(3).permutation(per).astype(np.int32)
    of_square = SHAPES[shape].square_map
    smoothed = smoothed_axes(of_square)
    numbers = of_square.shape, of_square.row_count, of_square.column_count
    rest = per, LATTICES[per], smoothed, 0
    out = [device.put(np.zeros((count, width))) for width in (3, 3, 2, 1)]
    given = [*(double3(v) for v in vectors), *map(np.int32, numbers), device.put(of_square.table)]
    given += [device.put(seeds), device.put(order), *map(np.int32, rest), np.int32(count), *out]
    device.run("launch_pupil", count, *given)
    square, weight = map(np.concatenate, zip(*(lattice_points(per, smoothed, seed) for seed in seeds), strict=True))
    rows = (per * np.arange(3)[:, None] + order).ravel()
    assert np.abs(device.get(out[2]) - of_square.points(square)[rows]).max() < 1e-12
    assert np.abs(device.get(out[3])[:, 0] - weight[rows]).max() < 1e-13
    assert np.abs(weight.reshape(3, per).mean(axis=1) - 1.0).max() < 1e-5


@pytest.mark.parametrize("replicates", [1, 3])
@pytest.mark.parametrize("count", [1, 63, GROUP, GROUP + 1, 3 * GROUP - 5])
def test_moments_are_sums_over_each_group(device: Device, count: int, replicates: int):
    """Expected: NumPy's sums of each group of rays; tolerance: GROUP additions, each rounded once.

    Each replicate begins with a new group; three replicates have weights, one has the same for all.
    """
    given = rays(replicates * count)
    group_count = replicates * -(-count // GROUP)
    out = device.put(np.zeros((group_count, SUM_COUNT)))
    names = ("pupil", "opd", "step_error", "evaluation_count", "status")
    weight = device.put(np.linspace(0.5, 1.5, replicates * count) if replicates > 1 else np.ones(1))
    ends = np.int32(count), np.int32(0), np.int32(group_count), np.int32(replicates * count if replicates > 1 else 1)
    # One work-group too many: what lies beyond group_count does nothing.
    surface = np.float64(7e6), double3([1e-7, 2e-8, -3e-8]), np.float64(5e-8)
    buffers = [device.put(given[name]) for name in names]
    device.run("sum_rays", 64 * (group_count + 1), *surface, *ends, weight, *buffers, out)
    found = device.get(out)
    for group in range(group_count):
        replicate, part = divmod(group, group_count // replicates)
        begin, end = replicate * count + part * GROUP, replicate * count + min((part + 1) * GROUP, count)
        rows = {name: values[begin:end] for name, values in given.items()}
        good = rows["status"] == RayStatus.OK
        (x, y), w = rows["pupil"][good].T, rows["opd"][good]
        share = np.linspace(0.5, 1.5, replicates * count)[begin:end][good] if replicates > 1 else 1.0
        terms = (np.ones_like(x), x, y, w, x * x, x * y, y * y, x * w, y * w, w * w)
        for k, term in enumerate(share * np.array(terms)):
            assert abs(found[group, k] - term.sum()) <= GROUP * 2.0**-52 * np.abs(term).sum(), k
        q = x * x + y * y
        for k, term in enumerate(share * np.array((x * q, y * q, q * q, q * w)), start=12):
            assert abs(found[group, k] - term.sum()) <= GROUP * 2.0**-52 * np.abs(term).sum(), k
        phase = 7e6 * (w - 1e-7 - rows["pupil"][good] @ [2e-8, -3e-8] - 5e-8 * q)
        phasor = np.sum(share * np.exp(1j * phase))
        assert abs(found[group, MOMENT_COUNT:] @ [1.0, 1.0j] - phasor) < GROUP * 1.5e-15
        assert found[group, 10] == rows["step_error"][good].max(initial=0.0)
        assert found[group, 11] == rows["evaluation_count"].sum()


@pytest.mark.parametrize("rows", [1, REDUCTION_WIDTH, REDUCTION_WIDTH + 1, 3 * REDUCTION_WIDTH - 2])
def test_rows_are_joined_by_replicate(device: Device, rows: int):
    """Sums of some rows each in their order, but for the greatest error; what lies beyond is left alone."""
    sums = np.random.default_rng(6).normal(size=(4, rows, SUM_COUNT))
    joined = -(-rows // REDUCTION_WIDTH)
    out = device.put(np.full(4 * joined * SUM_COUNT, 7.0))
    ends = np.int32(rows), np.int32(joined), np.int32(0), np.int32(3 * joined * SUM_COUNT)
    device.run("reduce_sums", 4 * joined * SUM_COUNT, *ends, device.put(sums), out)
    found = device.get(out).reshape(4, joined, SUM_COUNT)
    for part in range(joined):
        chosen = sums[:3, part * REDUCTION_WIDTH : (part + 1) * REDUCTION_WIDTH]
        expected = chosen.sum(axis=1)
        expected[:, 10] = np.maximum(chosen[:, :, 10].max(axis=1), 0.0)
        assert np.abs(found[:3, part] - expected).max() < 1e-12
    assert (found[3] == 7.0).all()


def test_more_rays_than_the_device_holds_are_refused():
    check_memory("Small", (2.0**30, 2.0**28), 1_000_000, 16)
    with pytest.raises(ValueError, match=r"'Small' has 1\.0 GiB.*fewer rays"):
        check_memory("Small", (2.0**30, 2.0**28), 10_000_000, 16)
