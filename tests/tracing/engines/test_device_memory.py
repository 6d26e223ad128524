"""A device whose memory other programs use: chunks become smaller, and where nothing fits the message says so."""

import os

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, RayBundle, prepare_strehl, trace
from aerokernels.tracing import launch
from aerokernels.tracing.engines.info import DeviceMemoryError, lacks_memory, memory_of

from ..backends import ENGINES, on
from ..opencl_stands import need_opencl, run_python

NODES = np.linspace(-1.0, 1.0, 12)
BUMP = np.exp(-4.0 * (NODES[:, None, None] ** 2 + NODES[:, None] ** 2 + NODES**2))
UNTIL = Plane((0.0, 0.0, 0.02), (0.0, 0.0, 1.0))


def field() -> IndexField:
    """A bump of 12 nodes a side over 12 mm."""
    return IndexField.from_samples(1e-5 * BUMP, origin=(-6e-3,) * 3, spacing=(12e-3 / 11,) * 3, geometry="volume")


def crossing_rays(count: int) -> RayBundle:
    """Rays of no family, each of which is traced."""
    draw = np.random.default_rng(3)
    ahead = np.concatenate([draw.normal(0.0, 0.02, (count, 2)), np.ones((count, 1))], axis=1)
    start = np.concatenate([draw.uniform(-3e-3, 3e-3, (count, 2)), np.full((count, 1), -0.01)], axis=1)
    return RayBundle(start, ahead / np.linalg.norm(ahead, axis=1)[:, None])


class Narrow:
    """An engine on which buffers of more than some rays do not fit, as its library reports it."""

    def __init__(self, engine, most: int, fault: Exception):
        self.engine, self.most, self.fault, self.refused = engine, most, fault, 0

    def __getattr__(self, name):
        """Return what the engine has."""
        return getattr(self.engine, name)

    def keeps(self, size: float) -> bool:
        """Results go to the host, chunk by chunk."""
        return False

    def empty(self, count: int, *shape):
        """Refuse large buffers."""
        if count > self.most:
            self.refused += 1
            raise self.fault
        return self.engine.empty(count, *shape)


FAULTS = (
    RuntimeError("Failed to allocate 480000000 bytes on device 'cuda:0'"),
    RuntimeError("Failed to acquire primary context for device cuda:0"),
)


@pytest.mark.parametrize("engine", ENGINES)
def test_chunks_become_smaller_until_they_fit(engine, monkeypatch):
    """Set-up: 3,000 rays where 100 fit at a time. Expected: the same bits, after refusals by factors of four."""
    rays, settings = crossing_rays(3000), {"until": UNTIL, "method": "adaptive", **on(engine)}
    expected = trace(field(), rays, **settings)
    made: list[Narrow] = []

    def narrow(backend: str, device: str):
        from aerokernels.tracing.engines import engine_of

        made.append(Narrow(engine_of(backend, device), 100, FAULTS[0]))
        real = made[-1].engine.prepare

        def prepare(*given):
            prepared = real(*given)
            prepared.engine = made[-1]
            return prepared

        made[-1].prepare = prepare
        return made[-1]

    monkeypatch.setattr(launch, "engine_of", narrow)
    found = trace(field(), rays, **settings)
    assert made[-1].refused == 3 and np.array_equal(found.status, expected.status)
    assert np.array_equal(found.opd, expected.opd) and np.array_equal(found.direction, expected.direction)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_device_without_room_for_a_few_rays_is_named(engine, monkeypatch):
    settings = {"until": UNTIL, "method": "adaptive", **on(engine)}

    def full(*given):
        raise FAULTS[1]

    from aerokernels.tracing.engines import engine_of

    kind = type(engine_of(settings["backend"], settings["device"]))
    monkeypatch.setattr(kind, "prepare", full)
    with pytest.raises(MemoryError, match=r"has not enough free memory.*end other programs"):
        trace(field(), crossing_rays(100), **settings)


def test_only_a_librarys_word_for_no_memory_is_translated():
    assert all(lacks_memory(fault) for fault in FAULTS)
    assert not lacks_memory(ValueError("out of memory")) and not lacks_memory(RuntimeError("no such device"))
    for fault in (ValueError("out of memory"), RuntimeError("no such device"), DeviceMemoryError("known")):
        with pytest.raises(type(fault)) as found, memory_of("cuda:0"):
            raise fault
        assert found.value is fault
    with (
        pytest.raises(DeviceMemoryError, match="device 'cuda:0' has not enough free memory") as found,
        memory_of("cuda:0"),
    ):
        raise FAULTS[0]
    assert found.value.__cause__ is FAULTS[0]


def test_opencls_own_refusal_is_recognised(tmp_path):
    """Set-up: PoCL on a processor, asked for a buffer of more memory than the process may have."""
    need_opencl("cpu")
    code = (
        "import resource, pyopencl as cl\n"
        "from aerokernels.tracing.engines.opencl.devices import session\n"
        "from aerokernels.tracing.engines.info import lacks_memory\n"
        "opened = session()\n"
        "used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()\n"
        "resource.setrlimit(resource.RLIMIT_AS, (used + (64 << 20), resource.RLIM_INFINITY))\n"
        "try: cl.Buffer(opened.context, cl.mem_flags.READ_WRITE | cl.mem_flags.ALLOC_HOST_PTR, 256 << 20)\n"
        "except Exception as fault: print(lacks_memory(fault), type(fault).__name__)\n"
        "else: print('allocated')\n"
    )
    done = run_python(code, tmp_path)
    assert done.returncode == 0 and done.stdout.startswith("True"), done.stdout + done.stderr


def filling(device, left: int) -> list:
    """Arrays that hold all but so many bytes of a GPU's free memory, or a little more."""
    import warp as wp

    held: list = []
    while (rest := min(device.free_memory - left, 1 << 30)) > 0:
        try:
            held.append(wp.empty(rest, dtype=wp.uint8, device=device))
        except RuntimeError:
            break
    return held


@pytest.mark.gpu
def test_rays_are_traced_on_a_gpu_that_is_nearly_full():
    """Set-up: other arrays hold all but 250 MB of the GPU; the rays and their results would take 800 MB.

    Expected: the bits of the free GPU. With 4 MB left the message names the device.
    """
    wp = pytest.importorskip("warp")
    if not wp.is_cuda_available() or os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1") not in ("1", "0"):
        pytest.skip("needs a GPU of its own")
    device, rays = wp.get_device("cuda:0"), crossing_rays(3_000_000)
    settings = {"until": UNTIL, "backend": "warp", "device": "cuda:0", "outputs": ("opd", "direction", "position")}
    expected = trace(field(), rays, **settings)
    numbers = np.array(expected.opd), np.array(expected.traced_status)
    del expected
    wp.synchronize_device(device)
    limit = wp.get_mempool_release_threshold(device)
    wp.set_mempool_release_threshold(device, 0)
    wp.synchronize_device(device)
    held = filling(device, 250 << 20)
    try:
        found = trace(field(), rays, **settings)
        assert np.array_equal(numbers[0], np.asarray(found.opd), equal_nan=True)
        assert np.array_equal(numbers[1], np.asarray(found.traced_status))
        del found
        held += filling(device, 4 << 20)
        with pytest.raises(MemoryError, match="'cuda:0' has not enough free memory"):
            large = np.random.default_rng(1).normal(0.0, 1e-6, (150, 150, 150))
            there = IndexField.from_samples(large, origin=(-6e-3,) * 3, spacing=(8e-5,) * 3, geometry="volume")
            prepare_strehl(there, Disc(1e-3, (0.0, 0.0, -0.01)), backend="warp", device="cuda:0", allow_truncation=True)
    finally:
        held.clear()
        wp.set_mempool_release_threshold(device, limit)
