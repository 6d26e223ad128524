"""Threads that use Warp, a device, a kernel or a file for the first time at once."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("warp")

THREADS = 8


def at_once(work: Callable[[], object]) -> list:
    """The results of a function that several threads call at the same time."""
    gate, found = threading.Barrier(THREADS), []

    def run() -> None:
        gate.wait()
        found.append(work())

    threads = [threading.Thread(target=run) for _ in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def test_one_thread_makes_the_context_of_a_device(monkeypatch):
    """Set-up: a device that takes 50 ms to make its context, as Warp's without a lock. Expected: one, whole for all."""
    import warp

    from aerokernels.process import quiet_warp

    class Device:
        alias, made, begun = "cuda:stand-in", 0, 0

        @property
        def context(self) -> int:
            if not self.begun:
                self.begun += 1
                time.sleep(0.05)
                self.made += 1
            return self.begun

    device = Device()
    monkeypatch.setattr(warp, "get_device", lambda name: device)
    assert at_once(lambda: quiet_warp.open_device("cuda:stand-in").made) == [1] * THREADS


def test_one_thread_loads_a_module():
    """The second copy would replace the first, whose code is then unloaded while it runs."""
    from aerokernels.device_arrays.launching import load_module

    class Module:
        loads = 0

        def load(self, device: str, block_size: int) -> None:
            time.sleep(0.05)
            self.loads += 1

    module = Module()
    assert at_once(lambda: [load_module(module, "cpu", 1), module.loads][1]) == [1] * THREADS


FIRST_USE = """
import sys, threading
import numpy as np
from aerokernels import Disc, IndexField, Plane, RayBundle, trace
x, z = np.linspace(-5e-3, 5e-3, 21), np.linspace(0.0, 20e-3, 49)
X, Y, Z = np.meshgrid(x, x, z, indexing="ij")
contrast = 1e-5 * np.exp(-(X**2 + Y**2) / 2e-3**2 - ((Z - 10e-3) / 4e-3) ** 2)
count, found = int(sys.argv[2]), {}
gate = threading.Barrier(count)
def opd(seed):
    field = IndexField.from_samples(
        contrast, origin=(x[0], x[0], 0.0), spacing=(x[1] - x[0],) * 2 + (z[1],), geometry="volume")
    rays = RayBundle.collimated(Disc(2e-3, (0.0, 0.0, -1e-3)), 2000, seed=seed)
    return trace(field, rays, until=Plane((0.0, 0.0, 25e-3), (0.0, 0.0, 1.0)), backend="warp", device=sys.argv[1]).opd
def work(seed):
    gate.wait()
    found[seed] = opd(seed)
threads = [threading.Thread(target=work, args=(seed,)) for seed in range(count)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert all(np.array_equal(found[seed], opd(seed)) for seed in range(count))
import warp as wp
if sys.argv[1] != "cpu":  # a stream that Warp does not know any more cannot be recorded
    with wp.ScopedCapture(sys.argv[1]):
        pass
print("as alone")
"""


@pytest.mark.slow
@pytest.mark.parametrize("device", ["cpu", "cuda:0"])
def test_rays_traced_by_threads_of_a_new_process(device: str):
    """Eight threads are the first to use a device: the bits are those of the same calls afterwards, one by one."""
    from aerokernels.tracing import available_backends

    if device not in {each.device for each in available_backends() if each.backend == "warp"}:
        pytest.skip(f"no device {device}")
    done = subprocess.run(
        [sys.executable, "-c", FIRST_USE, device, str(THREADS)],
        capture_output=True, encoding="utf-8", timeout=600, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    assert done.returncode == 0 and done.stdout.endswith("as alone\n"), done.stderr
