"""Trace the benchmark's cone scene and its bundles by other libraries: the same rays, the same truth, the same clocks.

Each is used as its documentation recommends. `aerokernels bench cone` measures this package on the cone scene; on the
bundles it is measured here, by its map of a bundle and ray by ray.

All of them read this package's own B-spline coefficients of the gridded field and integrate the equations of
aerokernels/benchmark/scenes.py in deviation form, so that a peer has no disadvantage by a coarser interpolant or by
float32's rounding of a long path. Their kernel time ends when results are ready on the device; the wall time includes
float64 arrays on the host. Rays are on the device before the clock starts.

    SciPy      DOP853 over all rays as one system, float64, NumPy lookups
    diffrax    jit(vmap(diffeqsolve)), float32; Tsit5 with adaptive steps, and with fixed ones
    Dr.Jit     fixed steps, a symbolic loop over 3-D textures, float32; half a drift, a kick, half a drift: one lookup a
               step. Cubic: value and gradient from one texture. Linear: a texture of four channels, value and gradient
               at the nodes. Textures are not read by the GPU's texture units, whose weights have 8 bits.
"""

import argparse
import importlib.util
import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.benchmark.measuring import chosen_rays, clocks, cone_error, errors, installed, measure, millions
from aerokernels.benchmark.scenes import (
    CONE_AMBIENT,
    CONE_HALF,
    CONE_SPACING,
    LONGEST_STEP,
    SIZES,
    WAVELENGTH,
    Truth,
    cone_field,
    cone_rays,
    cone_truth,
    end_direction,
    integrate,
    slopes,
)
from aerokernels.medium import IndexField
from aerokernels.medium.grid import UniformGrid
from aerokernels.process.foreign_files import fault_text
from aerokernels.rays import RayBundle
from aerokernels.tracing import trace
from scripts.studies.bundles import KINDS, BundleScene, bundle_scene, bundle_truth
from scripts.studies.report import markdown_table

PIP = "pip install 'aerokernels[bench]'"
# Greatest number of rays of a peer: a run takes seconds on two cores.
MOST_RAYS = {"scipy": 2048, "diffrax": 16384, "drjit": 1_000_000}
SCIPY_TOLERANCE = 1e-6
DIFFRAX_TOLERANCE = 1e-5
DIFFRAX_STEPS = 32
DRJIT_STEPS = (24, 32, 64)
BUNDLE_STEPS = (24, 32)  # the first miss the tolerance, the second meet it
COLUMNS = ("peer", "how", "rays", "M rays/s, kernel", "end to end", "per CPU s", "evaluations", "error")


@dataclass(frozen=True, eq=False)
class RayEnds:
    """The ends of rays on the face z = +8 mm.

    Attributes:
        direction: Unit tangents, shape (ray_count, 3).
        opd: Optical path less that of the undisturbed ray [m], shape (ray_count,).
        evaluations: Field evaluations of a ray.
        seconds: Time for tracing alone, before results are converted to this form.
    """

    direction: np.ndarray
    opd: np.ndarray
    evaluations: float
    seconds: float


def ray_ends(momentum_x: Any, momentum_y: Any, opd: Any, potential: Any, evaluations: float, seconds: float) -> RayEnds:
    """Directions and OPDs [m] from transverse momenta and the potential at the ends."""
    direction = end_direction(momentum_x, momentum_y, potential, CONE_AMBIENT)
    return RayEnds(direction, np.asarray(opd, dtype=np.float64), evaluations, seconds)


@dataclass(frozen=True, eq=False)
class Scheme:
    """One scheme of a peer: its description, precision and device, and a call that traces all rays.

    `start` starts the kernels without waiting for them, and `wait` waits, where the peer can do so.
    """

    text: str
    precision: str
    device: str
    run: Callable[[], RayEnds]
    start: Callable[[], Any] | None = None
    wait: Callable[[], None] | None = None


def cone_runs(ray_count: int, repeats: int) -> Iterator[dict]:
    """Measure every installed peer, scheme by scheme; for an absent one, report the reason."""
    field = cone_field()
    for peer, schemes in PEERS.items():
        missing = [name for name in NEEDS[peer] if importlib.util.find_spec(name) is None]
        if missing:
            yield _absent(peer, f"not installed: {', '.join(missing)}; {PIP}")
            continue
        rays = cone_rays(min(ray_count, MOST_RAYS[peer]))
        truth = cone_truth(rays[chosen_rays(rays.ray_count)])
        try:
            for scheme in schemes(field, rays):
                yield measured_scheme(peer, scheme, rays, truth, repeats)
        except Exception as error:  # a foreign package may raise anything; the other peers are still measured
            yield _absent(peer, f"failed: {fault_text(error)}")


def bundle_runs(ray_count: int, repeats: int) -> Iterator[dict]:
    """Measure this package on every bundle, and Dr.Jit on those through the cone scene."""
    drjit = importlib.util.find_spec("drjit") is not None
    if not drjit:
        yield _absent("drjit", f"not installed: drjit; {PIP}")
    for kind in KINDS:
        scene = bundle_scene(kind)
        rays, field = scene.make_rays(ray_count, 1), scene.make_field()
        truth = bundle_truth(scene, rays[chosen_rays(rays.ray_count)])
        schemes = {"aerokernels": own_schemes(scene, field, rays)}
        if drjit and kind != "turbulence":
            schemes["drjit"] = drjit_schemes(field, rays, BUNDLE_STEPS)
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


def _absent(peer: str, reason: str) -> dict:
    return {"peer": peer, "version": installed(peer), "available": False, "reason": reason}


def _grid(field: IndexField) -> UniformGrid:
    assert isinstance(field.samples, UniformGrid)
    return field.samples


def scipy_schemes(field: IndexField, rays: RayBundle) -> Iterator[Scheme]:
    """SciPy's DOP853."""
    grid = _grid(field)

    def potential(x, y, z):
        value, gradient = grid.evaluate_potential(np.stack([x, y, z], axis=1))
        return value, gradient.T

    text = f"DOP853 at a relative tolerance of {SCIPY_TOLERANCE:g}, cubic"

    def run() -> RayEnds:
        begin = time.perf_counter()
        found = integrate(potential, CONE_AMBIENT, CONE_HALF[2], LONGEST_STEP, rays, SCIPY_TOLERANCE)
        return RayEnds(found.direction, found.opd, float(found.evaluation_count), time.perf_counter() - begin)

    yield Scheme(text, "float64", "cpu", run)


def diffrax_schemes(field: IndexField, rays: RayBundle) -> Iterator[Scheme]:
    """Diffrax's Tsit5 on JAX's default device."""
    import diffrax
    import jax
    import jax.numpy as jnp

    grid = _grid(field)
    coefficients = jnp.asarray(grid.coefficients, dtype=jnp.float32)
    last = jnp.asarray(grid.shape) - 2

    def weights(u):
        v = 1.0 - u
        value = jnp.stack([v**3, 3 * u**3 - 6 * u**2 + 4, 3 * v**3 - 6 * v**2 + 4, u**3]) / 6
        slope = jnp.stack([-(v**2), 3 * u**2 - 4 * u, -3 * v**2 + 4 * v, u**2]) / (2 * CONE_SPACING)
        return value, slope

    def lookup(x, y, z):
        place = (jnp.stack([x, y, z]) + jnp.asarray(CONE_HALF)) / CONE_SPACING
        cell = jnp.clip(jnp.floor(place).astype(jnp.int32), 0, last)
        block = jax.lax.dynamic_slice(coefficients, cell, (4, 4, 4))
        (wx, sx), (wy, sy), (wz, _) = (weights(place[k] - cell[k]) for k in range(3))
        sheet = block @ wz
        rows = sheet @ wy
        return wx @ rows, sx @ rows, wx @ (sheet @ sy)

    def vector(z, state, _):
        x, y, momentum_x, momentum_y, _ = (entry * size for entry, size in zip(state, SIZES, strict=True))
        value, gradient_x, gradient_y = lookup(x, y, z)
        rates = slopes(value, gradient_x, gradient_y, momentum_x, momentum_y, CONE_AMBIENT, jnp.sqrt)
        return tuple(entry / size for entry, size in zip(rates, SIZES, strict=True))

    half, step = CONE_HALF[2], 2.0 * CONE_HALF[2] / DIFFRAX_STEPS
    adaptive = diffrax.PIDController(rtol=DIFFRAX_TOLERANCE, atol=DIFFRAX_TOLERANCE, dtmax=1e-3)
    x0, y0 = (jnp.asarray(rays.position[:, k], dtype=jnp.float32) for k in (0, 1))
    device = str(x0.device)

    def scheme(text: str, controller: Any) -> Scheme:
        def one(x, y):
            zero = jnp.zeros_like(x)
            found = diffrax.diffeqsolve(
                diffrax.ODETerm(vector),
                diffrax.Tsit5(),
                -half,
                half,
                step,
                (x / SIZES[0], y / SIZES[1], zero, zero, zero),
                stepsize_controller=controller,
                max_steps=100_000,
                adjoint=diffrax.ForwardMode(),
            )
            x, y, momentum_x, momentum_y, opd = (v[-1] * size for v, size in zip(found.ys, SIZES, strict=True))
            return momentum_x, momentum_y, opd, lookup(x, y, half)[0], found.stats["num_steps"]

        compiled = jax.jit(jax.vmap(one))

        def run() -> RayEnds:
            begin = time.perf_counter()
            found = jax.block_until_ready(compiled(x0, y0))
            spent = time.perf_counter() - begin
            momentum_x, momentum_y, opd, value, steps = found
            return ray_ends(momentum_x, momentum_y, opd, value, 6.0 * float(steps.mean()), spent)

        return Scheme(text, "float32", device, run)

    yield scheme(f"Tsit5, PID controller at rtol {DIFFRAX_TOLERANCE:g}, cubic", adaptive)
    yield scheme(f"Tsit5, {DIFFRAX_STEPS} fixed steps, cubic", diffrax.ConstantStepSize())


def drjit_schemes(field: IndexField, rays: RayBundle, step_counts: Iterable[int] = DRJIT_STEPS) -> Iterator[Scheme]:
    """Dr.Jit's textures, on a CUDA GPU where it has one, otherwise by LLVM on the CPU; rays of any directions."""
    import drjit as dr

    on_gpu = dr.has_backend(dr.JitBackend.CUDA)
    kind = importlib.import_module("drjit.cuda" if on_gpu else "drjit.llvm")
    grid = _grid(field)
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
            return ray_ends(momentum_x.numpy(), momentum_y.numpy(), opd.numpy(), value.numpy(), float(steps), spent)

        return Scheme(text, "float32", "cuda" if on_gpu else "cpu (LLVM)", run, start, dr.sync_thread)

    for steps in step_counts:
        yield scheme(f"{steps} fixed steps, cubic texture", cubic_lookup, steps)
        yield scheme(f"{steps} fixed steps, linear texture of value and gradient", linear_lookup, steps)


PEERS: dict[str, Callable[[IndexField, RayBundle], Iterator[Scheme]]] = {
    "scipy": scipy_schemes,
    "diffrax": diffrax_schemes,
    "drjit": drjit_schemes,
}
NEEDS = {"scipy": ("scipy",), "diffrax": ("diffrax", "jax"), "drjit": ("drjit",)}
RUNS = {"cone": cone_runs, "bundles": bundle_runs}


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
    """Measure the peers that are installed, and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/peers", description=__doc__.splitlines()[0])
    parser.add_argument("suites", nargs="*", metavar="SUITE", help="cone, bundles [both]")
    parser.add_argument("--rays", type=int, default=1_000_000, metavar="COUNT", help="rays of a trace, at most")
    parser.add_argument("--repeats", type=int, default=5, metavar="COUNT", help="timed calls of each scheme")
    parser.add_argument("--out", type=Path, help="write what was measured to this JSON file")
    options = parser.parse_args()
    for name in options.suites:
        if name not in RUNS:
            parser.error(f"{name!r} is no suite: choose among {', '.join(RUNS)}")
    if options.rays < 16 or options.repeats < 1:
        parser.error("give at least 16 rays and one timed call")
    found = [run for name in options.suites or RUNS for run in RUNS[name](options.rays, options.repeats)]
    print(markdown_table(COLUMNS, map(table_row, found), text_columns=2))
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
