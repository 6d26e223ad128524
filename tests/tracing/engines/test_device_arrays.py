"""Numbers of Warp's CPU device behave as those of a GPU do: read, written and picked out as NumPy would; limits."""

import pickle

import numpy as np
import pytest

from aerokernels import RayBundle
from aerokernels.device_arrays import pinned
from aerokernels.device_arrays.array import DeviceArray, extremes_of, host_array, is_one_row, rows_where
from aerokernels.device_arrays.rays import checked_rays
from aerokernels.tracing.engines import available_backends, engine_of

from ..backends import WARP, on

wp = pytest.importorskip("warp")
RANDOM = np.random.default_rng(5)
PLACES = RANDOM.normal(size=(50, 3))


def there(values) -> DeviceArray:
    values = np.asarray(values)
    kind = wp.vec3d if values.ndim == 2 else {"f": wp.float64, "i": wp.int32}[values.dtype.kind]
    return DeviceArray(wp.array(values, dtype=kind, device="cpu"))


@pytest.mark.parametrize("rows", [[50], [0, -51], np.ones(3, bool)], ids=["beyond", "before", "short mask"])
@pytest.mark.parametrize("read", [False, True])
def test_rows_that_are_not_there_are_refused(rows, read):
    """As NumPy does; they wrapped round to others where the array had not been read before."""
    array = there(PLACES)
    if read:
        assert len(array.host) == 50
    with pytest.raises(IndexError):
        array[np.asarray(rows)]


@pytest.mark.parametrize("engine", WARP)
def test_rows_are_read_and_written_without_the_others(engine):
    device, values = on(engine)["device"], np.random.default_rng(1).normal(size=(5000, 3))
    array = DeviceArray(wp.array(values, dtype=wp.vec3d, device=device))
    rows = np.array([4999, 0, 17, 17])
    assert np.array_equal(array[rows], values[rows])
    assert np.array_equal(array[100:103], values[100:103])
    assert np.array_equal(array[values[:, 0] > 2.0], values[values[:, 0] > 2.0])
    ends = extremes_of(array)
    assert np.array_equal(ends.low, values.min(axis=0)) and np.array_equal(ends.high, values.max(axis=0))
    assert np.array_equal(ends.rows, extremes_of(values).rows)
    array[np.array([3, 1])] = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    values[[3, 1]] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert np.array_equal(array.host, values)
    assert np.array_equal(pickle.loads(pickle.dumps(array)), values)

    status = np.where(np.arange(5000) % 3 == 1, 7, 0).astype(np.int32)  # more than there is room for at once
    error = np.where(np.arange(5000) == 9, np.nan, np.where(np.arange(5000) == 2, 2.0, 1.0))
    for codes in (7, 5):
        held = [DeviceArray(wp.array(each, device=device)) for each in (np.repeat(status, 3), np.repeat(error, 3))]
        host = np.repeat(status, 3), np.repeat(error, 3)
        expected = np.flatnonzero((host[0] == codes) | ~(host[1] <= 1.0))
        assert len(expected) > (4096 if codes == 7 else 0)
        assert np.array_equal(rows_where(held[0], codes, held[1], 1.0), expected)
        assert np.array_equal(rows_where(*held[:1], codes), np.flatnonzero(host[0] == codes))

    # The same by numbers of rows that lie on the device, and values that do.
    there = wp.array(np.flatnonzero(status == 7), dtype=wp.int32, device=device)
    assert np.array_equal(array.part(there).host, values[status == 7])
    array[there] = DeviceArray(wp.array(-values[status == 7], dtype=wp.vec3d, device=device))
    assert np.array_equal(array.host, np.where((status == 7)[:, None], -values, values))


def test_ends_are_those_of_what_was_written():
    array = there(PLACES.copy())
    before = extremes_of(array).high[0]
    array[np.array([3], np.int32)] = np.full((1, 3), 2.0 * before)
    assert extremes_of(array).high[0] == 2.0 * before


def test_the_ends_of_places_and_the_rays_that_have_them():
    found, expected = extremes_of(there(PLACES)), extremes_of(PLACES)
    for name in ("low", "high", "rows"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    array = there(PLACES)
    assert extremes_of(array) is extremes_of(array)
    assert is_one_row(np.broadcast_to(PLACES[0], (9, 3))) and not is_one_row(PLACES) and not is_one_row(array)


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
