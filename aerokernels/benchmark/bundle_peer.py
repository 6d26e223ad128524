"""Dr.Jit on bundles of any kind through the cone scene: fixed steps of deviations from the straight line, float32.

One lookup a step in a texture of potential and gradient at the nodes, linear between them, by software; half a drift, a
kick, half a drift. Rays and field are on the device before the clock starts, and results stay there.
"""

import importlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.rays import RayBundle
from aerokernels.validation.cone import CONE_AMBIENT, CONE_HALF, CONE_NODES, CONE_SPACING, cone_potential

STEPS = (24, 32)


@dataclass(frozen=True, eq=False)
class PeerRun:
    """A scheme, its times [s] and its results."""

    scheme: str
    device: str
    steps: int
    seconds: list[float]
    cpu_seconds: list[float]
    direction: np.ndarray
    opd: np.ndarray


def drjit_runs(rays: RayBundle, repeats: int) -> Iterator[PeerRun]:
    """Dr.Jit by each number of steps; on a CUDA GPU where it has one, by LLVM on the CPU otherwise."""
    import drjit as dr

    on_gpu = dr.has_backend(dr.JitBackend.CUDA)
    kind = importlib.import_module("drjit.cuda" if on_gpu else "drjit.llvm")
    texture = _texture(kind)
    dr.eval(texture.tensor(), texture.value())
    scale = [1.0 / (CONE_SPACING * count) for count in CONE_NODES]
    shift = [(half / CONE_SPACING + 0.5) / count for half, count in zip(CONE_HALF, CONE_NODES, strict=True)]
    (x, y, _), (dx, dy, d) = rays.position.T, rays.direction.T
    x0, y0, tx, ty, dz = (kind.Float(np.ascontiguousarray(v, np.float32)) for v in (x, y, dx / d, dy / d, d))
    dr.eval(x0, y0, tx, ty, dz)
    a, depth = float(CONE_AMBIENT), float(CONE_HALF[2])

    def step_of(length: float) -> Callable[..., tuple[Any, ...]]:
        def body(i: Any, qx: Any, qy: Any, mx: Any, my: Any, opd: Any) -> tuple[Any, ...]:
            z = dr.fma(kind.Float(i) + 0.5, length, -depth)
            place = (
                x0 + tx * (z + depth) + qx + 0.5 * length / a * mx,
                y0 + ty * (z + depth) + qy + 0.5 * length / a * my,
                z,
            )
            at = kind.Array3f(*(dr.fma(axis, scale[k], shift[k]) for k, axis in enumerate(place)))
            s, gx, gy, _ = texture.eval(at)
            hx, hy = mx + 0.5 * length / a * gx, my + 0.5 * length / a * gy
            more = 2.0 * s - 2.0 * a * dz * (tx * hx + ty * hy) - hx * hx - hy * hy
            pz = dr.sqrt(dr.square(a * dz) + more)
            lag = more / (pz + a * dz)
            r = 1.0 / (pz * dz)
            qx += length * (hx * dz - tx * dz * lag) * r
            qy += length * (hy * dz - ty * dz * lag) * r
            opd += length * (2.0 * s * dz - a * lag) * r
            return i + 1, qx, qy, mx + length / pz * gx, my + length / pz * gy, opd

        return body

    for steps in STEPS:
        body = step_of(2.0 * depth / steps)

        def run(body: Any = body, steps: int = steps) -> tuple[float, float, tuple[Any, ...]]:
            zeros = [dr.zeros(kind.Float, rays.ray_count) for _ in range(5)]
            begin, spent = time.perf_counter(), time.process_time()
            out = dr.while_loop((kind.UInt(0), *zeros), lambda i, *_: i < steps, body)
            dr.eval(*out)
            dr.sync_thread()
            return time.perf_counter() - begin, time.process_time() - spent, out

        run()
        found = [run() for _ in range(repeats)]
        out = found[-1][2]
        px, py = a * dx + out[3].numpy(), a * dy + out[4].numpy()
        direction = np.stack([px, py, np.sqrt(a * a - px * px - py * py)], axis=1) / a
        opd = out[5].numpy().astype(float)
        scheme = f"Dr.Jit, {steps} fixed steps, linear texture of value and gradient"
        device = "cuda" if on_gpu else "cpu (LLVM)"
        yield PeerRun(scheme, device, steps, [f[0] for f in found], [f[1] for f in found], direction, opd)


def _texture(kind: Any) -> Any:
    axes = [np.arange(count) * CONE_SPACING - half for count, half in zip(CONE_NODES, CONE_HALF, strict=True)]
    value, gradient = cone_potential(*(axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")))
    channels = np.c_[value, gradient.T].reshape(*CONE_NODES, 4).transpose(2, 1, 0, 3)
    return kind.Texture3f(kind.TensorXf(np.ascontiguousarray(channels, np.float32)), use_accel=False)
