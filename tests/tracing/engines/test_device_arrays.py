"""Numbers of Warp's CPU device behave as those of a GPU do: read, written and picked out as NumPy would; limits."""

import numpy as np
import pytest

from aerokernels import RayBundle
from aerokernels.device_arrays import pinned
from aerokernels.device_arrays.array import DeviceArray, extremes_of, host_array, is_one_row, rows_where
from aerokernels.device_arrays.rays import checked_rays
from aerokernels.tracing.engines import available_backends, engine_of

wp = pytest.importorskip("warp")
RANDOM = np.random.default_rng(5)
PLACES = RANDOM.normal(size=(50, 3))


def there(values) -> DeviceArray:
    values = np.asarray(values)
    kind = wp.vec3d if values.ndim == 2 else {"f": wp.float64, "i": wp.int32}[values.dtype.kind]
    return DeviceArray(wp.array(values, dtype=kind, device="cpu"))


@pytest.mark.parametrize(
    "rows",
    [
        slice(3, 9),
        slice(9, 3),
        slice(1, 40, 7),
        slice(None),
        [4, -1, 4],
        np.arange(50) % 3 == 0,
        np.zeros(50, bool),
        [],
    ],
    ids=lambda rows: str(rows).partition("\n")[0],
)
@pytest.mark.parametrize("read", [False, True])
def test_rows_are_those_of_numpy(rows, read):
    """Expected: what NumPy gives of the same rows, whether all were read before or these alone."""
    array = there(PLACES)
    if read:
        assert array.host.shape == (50, 3)
    rows = np.array(rows, int) if isinstance(rows, list) else rows
    assert np.array_equal(array[rows], PLACES[rows]) and array[rows].dtype == np.float64
    assert len(array) == 50 and array.device == "cpu" and np.array_equal(np.asarray(array), PLACES)


@pytest.mark.parametrize("rows", [[50], [0, -51], np.ones(3, bool)], ids=["beyond", "before", "short mask"])
@pytest.mark.parametrize("read", [False, True])
def test_rows_that_are_not_there_are_refused(rows, read):
    """As NumPy does; they wrapped round to others where the array had not been read before."""
    array = there(PLACES)
    if read:
        assert len(array.host) == 50
    with pytest.raises(IndexError):
        array[np.asarray(rows)]


def test_ends_are_those_of_what_was_written():
    array = there(PLACES.copy())
    before = extremes_of(array).high[0]
    array[np.array([3], np.int32)] = np.full((1, 3), 2.0 * before)
    assert extremes_of(array).high[0] == 2.0 * before


@pytest.mark.parametrize("given", ["host", "device"])
@pytest.mark.parametrize("numbers", ["host", "device"])
def test_rows_are_written_where_they_belong(given, numbers):
    rows, values = np.array([7, 2, 30], np.int32), RANDOM.normal(size=(3, 3))
    array, expected = there(PLACES.copy()), PLACES.copy()
    expected[rows] = values
    at = wp.array(rows, dtype=wp.int32, device="cpu") if numbers == "device" else rows
    array[at] = there(values) if given == "device" else values
    array[rows[:0]] = values[:0]
    assert np.array_equal(np.asarray(array), expected)
    assert np.array_equal(np.asarray(array.part(at)), values)


def test_the_ends_of_places_and_the_rays_that_have_them():
    found, expected = extremes_of(there(PLACES)), extremes_of(PLACES)
    for name in ("low", "high", "rows"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    array = there(PLACES)
    assert extremes_of(array) is extremes_of(array)
    assert is_one_row(np.broadcast_to(PLACES[0], (9, 3))) and not is_one_row(PLACES) and not is_one_row(array)


@pytest.mark.parametrize("count", [0, 1, 9000])
def test_rays_of_a_status(count):
    """More than there is room for at once; expected are the same numbers, ascending."""
    status, error = np.zeros(10000, np.int32), np.full(10000, 0.5)
    chosen = np.sort(RANDOM.permutation(10000)[:count])
    status[chosen] = 3
    assert np.array_equal(np.asarray(there(status)[:]), status)
    assert np.array_equal(rows_where(there(status), 3), chosen) and np.array_equal(rows_where(status, 3), chosen)
    error[[11, 12]] = 2.0, np.nan
    expected = np.union1d(chosen, [11, 12])
    for kinds in ((there(status), there(error)), (status, error)):
        assert np.array_equal(rows_where(kinds[0], 3, kinds[1], 1.0), expected)


def test_rays_that_another_library_made_are_checked_where_they_lie():
    """Expected: as RayBundle has them on the host, to rounding; single precision and one direction for all too."""
    ways = RANDOM.normal(size=(50, 3))
    for place, way in ((PLACES, ways), (PLACES, ways[:1]), (PLACES.astype(np.float32), ways.astype(np.float32))):
        kind = wp.float64 if place.dtype == np.float64 else wp.float32
        found = checked_rays(wp.array(place, dtype=kind, device="cpu"), wp.array(way, dtype=kind, device="cpu"))
        expected = RayBundle(place, way)
        assert np.array_equal(found[0].host, expected.position)
        assert found[1].host == pytest.approx(expected.direction, abs=4e-16)
    assert np.array_equal(checked_rays(wp.array(PLACES, dtype=wp.float64, device="cpu"), ways)[0].host, PLACES)
    broken = {"place": PLACES.copy(), "way": ways.copy(), "zero": ways.copy()}
    broken["place"][[3, 5], 1], broken["way"][7], broken["zero"][9:12] = np.nan, np.inf, 0.0
    for place, way, told in (
        (broken["place"], ways, "2 ray positions are not finite, the first is ray 3"),
        (PLACES, broken["way"], "1 ray directions are not finite, the first is ray 7"),
        (PLACES, broken["zero"], "3 ray directions are zero, the first is ray 9"),
        (PLACES, ways[:7], "50 ray positions but 7 directions"),
        (PLACES[:, :2].copy(), ways, r"ray positions must have shape \(ray_count, 3\), got \(50, 2\)"),
    ):
        for made in (RayBundle, lambda a, b: checked_rays(wp.array(a, dtype=wp.float64, device="cpu"), b)):
            with pytest.raises(ValueError, match=told):
                made(place, way)


def test_rays_are_brought_chunk_by_chunk():
    target = [wp.zeros(50, dtype=wp.vec3d, device="cpu"), wp.zeros(50, dtype=wp.float64, device="cpu")]
    given = [np.ascontiguousarray(PLACES), np.arange(50.0)]
    chunks = list(pinned.bring(given, target, rows=20))
    assert [(chunk.start, chunk.stop) for chunk in chunks] == [(0, 20), (20, 40), (40, 50)]
    assert np.array_equal(target[0].numpy(), PLACES) and np.array_equal(target[1].numpy(), given[1])


def test_pinned_memory_is_used_again_and_bounded(monkeypatch):
    """A quarter of 64 MB may be pinned, of which 8 MB is kept though nobody uses it. Memory is stood in for."""
    made = []

    def empty(size):
        if len(made) > 20:
            raise RuntimeError("no more")
        made.append(size)
        return np.zeros(size, np.uint8)

    size = pinned.LEAST
    monkeypatch.setattr(pinned, "host_memory", lambda: 64.0 * size)
    monkeypatch.setattr(pinned, "KEPT", 8 * size)
    memory = pinned.PinnedMemory(empty)
    first = memory.take(size - 5)
    assert first.size == size  # whole pages
    memory.give_back(first)
    assert memory.take(size) is first and memory.take(size // 2) is not first
    big = memory.take(9 * size)
    memory.give_back(first)
    memory.give_back(big)  # more than is kept: both go, the eldest first
    before = len(made)
    held = [memory.take(2 * size) for _ in range(12)]
    # Of 16 MB one is still lent, and no two fit beside seven twos.
    assert len(made) == before + 7 and sum(each is not None for each in held) == 7
    made.extend([0] * 20)
    assert pinned.PinnedMemory(empty).take(size) is None  # the driver has none


def test_opencl_lends_its_pinned_memory_again():
    """Results are copied to it; it is free once the last array on it is gone. PoCL stands in for a GPU's driver."""
    if not any(info.backend == "opencl" and info.available for info in available_backends()):
        pytest.skip("no OpenCL here")
    engine = engine_of("opencl", None)
    engine.is_gpu = True  # of this object alone
    memory = engine.session.pinned
    values = RANDOM.normal(size=(1 << 17, 3))
    lent = engine.room(values.shape, np.float64)
    engine.get(engine.put(values), lent)
    assert np.array_equal(lent, values)
    part, address = lent[5:], lent.ctypes.data
    del lent
    other = engine.room(values.shape, np.float64)
    assert other.ctypes.data != address and np.array_equal(part, values[5:])
    del part
    assert engine.room(values.shape, np.float64).ctypes.data == address
    assert engine.room((7,), np.int32).base is None and memory.take(1 << 62) is None


def test_what_is_no_array_of_numbers_is_refused():
    for found in (np.array(["a"]), np.array([1j]), {"a": 1}):
        with pytest.raises(TypeError, match="a snapshot must be an array of real numbers"):
            host_array(found)
    assert host_array(np.array([1, 2])).dtype == np.float64
