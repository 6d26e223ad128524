"""Trace bundles of rays by this package and by Dr.Jit: the same rays, the same truth, the same clocks.

Dr.Jit, used as its documentation recommends, reads this package's own B-spline coefficients of the gridded field and
integrates the equations of aerokernels/benchmark/scenes.py in deviation form, so that it has no disadvantage by a
coarser interpolant or by float32's rounding of a long path: fixed steps, a symbolic loop over 3-D textures, float32;
half a drift, a kick, half a drift: one lookup a step. Cubic: value and gradient from one texture. Linear: a texture of
four channels, value and gradient at the nodes. Textures are not read by the GPU's texture units, whose weights have 8
bits. The kernel time ends when results are ready on the device; the wall time includes float64 arrays on the host.
"""

import argparse
import importlib.util
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.benchmark.measuring import chosen_rays, clocks, cone_error, errors, installed, measure, millions
from aerokernels.benchmark.scenes import (
    CONE_AMBIENT,
    CONE_HALF,
    CONE_SPACING,
    WAVELENGTH,
    Truth,
    end_direction,
    slopes,
)
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import trace
from scripts.studies.bundles import KINDS, BundleScene, bundle_scene, bundle_truth
from scripts.studies.report import markdown_table

STEPS = (24, 32)  # the first miss the tolerance, the second meet it
COLUMNS = ("peer", "how", "rays", "M rays/s, kernel", "end to end", "per CPU s", "evaluations", "error")


@dataclass(frozen=True, eq=False)
class RayEnds:
    """The ends of rays on the face z = +8 mm."""

    direction: np.ndarray  # unit tangents, shape (ray_count, 3)
    opd: np.ndarray  # optical path less that of the undisturbed ray [m], shape (ray_count,)
    evaluations: float  # field evaluations of a ray
    seconds: float  # for tracing alone, before results are converted to this form


@dataclass(frozen=True, eq=False)
class Scheme:
    """One scheme of a peer: its description, precision and device, and a call that traces all rays."""

    text: str
    precision: str
    device: str
    run: Callable[[], RayEnds]


def bundle_runs(ray_count: int, repeats: int) -> Iterator[dict]:
    """Measure this package on every bundle, and Dr.Jit on those through the cone scene."""
    drjit = importlib.util.find_spec("drjit") is not None
    if not drjit:
        reason = "not installed: pip install 'aerokernels[bench]'"
        yield {"peer": "drjit", "version": None, "available": False, "reason": reason}
    for kind in KINDS:
        scene = bundle_scene(kind)
        rays, field = scene.make_rays(ray_count, 1), scene.make_field()
        truth = bundle_truth(scene, rays[chosen_rays(rays.ray_count)])
        schemes = {"aerokernels": own_schemes(scene, field, rays)}
        if drjit and kind != "turbulence":
            schemes["drjit"] = drjit_schemes(field, rays)
        for peer, each in schemes.items():
            for scheme in each:
                yield measured_scheme(peer, replace(scheme, text=f"{kind}: {scheme.text}"), rays, truth, repeats)


def own_schemes(scene: BundleScene, field: IndexField, rays: RayBundle) -> Iterator[Scheme]:
    """This package's map of the bundle, and every ray by itself."""
    for bundle in ("auto", "off"):

        def run(bundle: str = bundle) -> RayEnds:
            options = {"until": scene.until, "wavelength": WAVELENGTH, "outputs": ("direction", "opd")}
            found = trace(field, rays, bundle=bundle, **options)
            predicted = found.plan.predicted_evaluations
            evaluations = float("nan") if predicted is None else predicted
            return RayEnds(found.direction, found.opd, evaluations, found.seconds["kernel"])

        yield Scheme(f"bundle {bundle}", "float32", "auto", run)


def measured_scheme(peer: str, scheme: Scheme, rays: RayBundle, truth: Truth, repeats: int) -> dict:
    """Clocks and errors of a scheme; `truth` has the ends of `chosen_rays`."""
    rows = chosen_rays(rays.ray_count)
    timing = measure(scheme.run, repeats)
    ends = timing.results[-1]
    kernel = [each.seconds for each in timing.results]
    return {
        "peer": peer,
        "version": installed(peer),
        "available": True,
        "reason": None,
        "scheme": scheme.text,
        "precision": scheme.precision,
        "device": scheme.device,
        "rays_traced": rays.ray_count,
        "repeats": repeats,
        "first_call_seconds": timing.first_seconds,
        "evaluations_per_ray": ends.evaluations,
        "error": errors(truth, ends.direction[rows], ends.opd[rows]),
        **clocks(rays.ray_count, kernel, timing.wall_seconds, timing.cpu_seconds),
    }


def drjit_schemes(field: IndexField, rays: RayBundle) -> Iterator[Scheme]:
    """Dr.Jit's textures, on a CUDA GPU where it has one, otherwise by LLVM on the CPU; rays of any directions."""
    import drjit as dr

    on_gpu = dr.has_backend(dr.JitBackend.CUDA)
    kind = importlib.import_module("drjit.cuda" if on_gpu else "drjit.llvm")
    grid = field.samples
    # Textures have the axes z, y, x, channel; the spline has one coefficient before the first and behind the last node.
    spline = np.ascontiguousarray(grid.coefficients.transpose(2, 1, 0)[..., None], dtype=np.float32)
    cubic_shape = np.array(grid.shape) + 2
    nodes = np.meshgrid(*(np.arange(count) * CONE_SPACING for count in grid.shape), indexing="ij")
    value, gradient = grid.evaluate_potential(np.stack([axis.ravel() for axis in nodes], axis=1) + grid.origin)
    channels = np.c_[value, gradient[:, :2], np.zeros(len(value))].reshape(*grid.shape, 4)
    linear = np.ascontiguousarray(channels.transpose(2, 1, 0, 3), dtype=np.float32)

    def texture(values):
        return kind.Texture3f(kind.TensorXf(values), use_accel=False)

    def placed(shape, first):
        """Return the map to texture coordinates: node `first` + i of an axis is the middle of its texel."""
        scale = [1.0 / (CONE_SPACING * count) for count in shape]
        shift = [(half / CONE_SPACING + first + 0.5) / count for half, count in zip(CONE_HALF, shape, strict=True)]
        return lambda x, y, z: kind.Array3f(*(dr.fma(axis, scale[k], shift[k]) for k, axis in enumerate((x, y, z))))

    across = 1.0 / (CONE_SPACING * cubic_shape)
    spline_texture, spline_place = texture(spline), placed(cubic_shape, 1.0)
    node_texture, node_place = texture(linear), placed(grid.shape, 0.0)

    def cubic_lookup(x, y, z):
        values, gradients = spline_texture.eval_cubic_grad(spline_place(x, y, z))
        # The gradients are with respect to texture coordinates.
        return values[0], gradients[0][0] * across[0], gradients[0][1] * across[1]

    def linear_lookup(x, y, z):
        return tuple(node_texture.eval(node_place(x, y, z))[:3])

    along = rays.direction[:, 2]
    x0, y0, momentum_x0, momentum_y0, along, aslant = (
        kind.Float(array.astype(np.float32))
        for array in (
            *rays.position[:, :2].T,
            *(CONE_AMBIENT * rays.direction[:, :2]).T,
            CONE_AMBIENT * along,
            CONE_AMBIENT * (1.0 - 1.0 / along),  # excess of the undisturbed ray's path over n along z
        )
    )

    def scheme(text: str, lookup, steps: int) -> Scheme:
        length = 2.0 * CONE_HALF[2] / steps
        drift = 0.5 * length / along

        def body(i, x, y, momentum_x, momentum_y, opd):
            z = dr.fma(kind.Float(i) + 0.5, length, -CONE_HALF[2])
            x += drift * momentum_x
            y += drift * momentum_y
            value, gradient_x, gradient_y = lookup(x, y, z)
            # The path takes the momentum in the middle of the kick.
            half_x = dr.fma(drift, gradient_x, momentum_x)
            half_y = dr.fma(drift, gradient_y, momentum_y)
            *_, force_x, force_y, path = slopes(value, gradient_x, gradient_y, half_x, half_y, CONE_AMBIENT, dr.sqrt)
            momentum_x = dr.fma(length, force_x, momentum_x)
            momentum_y = dr.fma(length, force_y, momentum_y)
            opd = dr.fma(length, path + aslant, opd)
            x += drift * momentum_x
            y += drift * momentum_y
            return i + 1, x, y, momentum_x, momentum_y, opd

        def start() -> Any:
            opd = dr.zeros(kind.Float, rays.ray_count)
            state = (kind.UInt(0), *(kind.Float(one) for one in (x0, y0, momentum_x0, momentum_y0)), opd)
            _, x, y, momentum_x, momentum_y, opd = dr.while_loop(state, lambda i, *_: i < steps, body)
            value = lookup(x, y, kind.Float(CONE_HALF[2]))[0]
            dr.eval(momentum_x, momentum_y, opd, value)
            return momentum_x, momentum_y, opd, value

        def run() -> RayEnds:
            begin = time.perf_counter()
            momentum_x, momentum_y, opd, value = start()
            dr.sync_thread()
            spent = time.perf_counter() - begin
            direction = end_direction(momentum_x.numpy(), momentum_y.numpy(), value.numpy(), CONE_AMBIENT)
            return RayEnds(direction, np.asarray(opd.numpy(), dtype=np.float64), float(steps), spent)

        return Scheme(text, "float32", "cuda" if on_gpu else "cpu (LLVM)", run)

    for steps in STEPS:
        yield scheme(f"{steps} fixed steps, cubic texture", cubic_lookup, steps)
        yield scheme(f"{steps} fixed steps, linear texture of value and gradient", linear_lookup, steps)


def table_row(run: dict) -> tuple[str, ...]:
    """One scheme as texts, in the order of COLUMNS."""
    if not run["available"]:
        return (run["peer"], run["reason"], *["-"] * (len(COLUMNS) - 2))
    return (
        f"{run['peer']} {run['version']} {run['device']}",
        f"{run['scheme']}, {run['precision']}",
        str(run["rays_traced"]),
        *(millions(run[key]) for key in ("kernel_rays_per_second", "rays_per_second", "rays_per_cpu_second")),
        f"{run['evaluations_per_ray']:.1f}",
        cone_error(run["error"]),
    )


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/peers", description=__doc__.splitlines()[0])
    parser.add_argument("--rays", type=int, default=1_000_000, metavar="COUNT", help="rays of a trace, at most")
    parser.add_argument("--repeats", type=int, default=5, metavar="COUNT", help="timed calls of each scheme")
    parser.add_argument("--out", type=Path, help="write what was measured to this JSON file")
    options = parser.parse_args()
    if options.rays < 16 or options.repeats < 1:
        parser.error("give at least 16 rays and one timed call")
    found = list(bundle_runs(options.rays, options.repeats))
    print(markdown_table(COLUMNS, map(table_row, found), text_columns=2))
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
