"""Trace a random scene, and compare the errors told with the true ones."""

from typing import Any

import numpy as np

import aerokernels as ak
from aerokernels.tracing.variants.causes import errors, of_each
from aerokernels.tracing.variants.paths import Rays

from .quantities import Numbers
from .scenes import make

# Cells are large, so that rays are straight to second order.
WAVELENGTH, CELL = 905e-9, 1.0
# Distance from the box to the stop [cells], and rays of the pupil.
BEYOND, RAYS = 200.0, 2048
# True errors below this share of a number, or of the OPD rms, are not compared, nor those below what straight lines, as
# the truth has them, leave out.
LEAST = 1e-6


def one(kind: str, seed: int) -> dict[str, Any]:
    """Return the true and the told errors of a scene's numbers, and of what its rays have of their own."""
    scene = make(kind, seed)
    rng = np.random.default_rng(seed)
    high = np.array(scene.data.shape) - 1.0
    pupil = ak.Disc(scene.radius * CELL, scene.center * CELL, scene.way)
    whole = ak.RayBundle.collimated(pupil, RAYS, seed=seed)
    position = whole.position / CELL
    start, end = _through(scene, position, high)
    stop = end.mean(axis=0) + BEYOND * scene.way
    true = scene.truth.lines(start, end, (stop - end) @ scene.way)
    scale = WAVELENGTH * np.exp(rng.uniform(np.log(0.03), np.log(0.25))) / true.opd.std()
    field = ak.IndexField.from_samples(
        scene.data * scale / CELL,
        origin=np.zeros(len(high)),
        spacing=np.full(len(high), CELL),
        geometry=scene.geometry,
        interpolation=scene.interpolation,
        cell_averages=scene.averages,
        wavelength=WAVELENGTH,
    )
    true = Rays(true.opd * scale, true.direction * scale / CELL, true.position * scale)
    rays = ak.RayBundle(start * CELL - 2.0 * CELL * scene.way, whole.direction)
    until = ak.Plane(stop * CELL, scene.way)
    traced = ak.trace(field, rays, until=until, method="adaptive", precision="float64", tolerance=1e-7, bundle="off")
    got = Rays(traced.opd, traced.direction - scene.way, _moved(traced.position, rays.position, scene.way))
    found = traced.variants
    x = (position - scene.center) @ _axes(scene.way).T / scene.radius
    numbers, of_all = (
        Numbers(_of(found, x, rays), scene.radius * CELL, WAVELENGTH),
        Numbers(x, scene.radius * CELL, WAVELENGTH),
    )
    value, exact = of_all(got), of_all(true)
    bent = 4.0 * float(np.mean(np.sum(true.direction**2, axis=1)) * np.linalg.norm(end - start, axis=1).mean() * CELL)
    told = np.sqrt(sum(error**2 for error in errors(numbers, found).values()))
    by_cause = {name: list(map(float, error)) for name, error in errors(numbers, found).items()}
    result: dict[str, Any] = {"kind": kind, "seed": seed, "numbers": {}, "rays": {}, "causes": by_cause}
    for k, name in enumerate(numbers.names):
        size = numbers.scale(name, exact[k], exact[1]) * max(1.0, bent / exact[1] / LEAST)
        result["numbers"][name] = (abs(value[k] - exact[k]), float(told[k]), size)
    picks = {
        "opd": lambda rays: rays.opd - rays.opd.mean(),
        "schlieren": lambda rays: rays.direction @ _axes(scene.way)[1],
        "displacement": lambda rays: rays.position @ _axes(scene.way)[1],
    }
    sizes = {name: float(np.std(getattr(true, name), axis=0).max()) for name in ("opd", "direction", "position")}
    for (name, pick), whole in zip(picks.items(), sizes.values(), strict=True):
        error, size = pick(got - true), whole * max(1.0, bent / exact[1] / LEAST)
        bar = float(np.sqrt(sum(one[0] ** 2 for one in of_each(pick, found).values())))
        result["rays"][name] = (float(np.sqrt(np.mean(error**2))), bar, size, float(np.mean(np.abs(error) <= bar)))
    return result


def _through(scene, position: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where lines through points enter and leave the box, both (n, 3) [cells]."""
    axis = int(np.argmax(np.abs(scene.way)))
    if scene.geometry == "axisymmetric" and axis < 2:
        inside = np.sqrt(high[0] ** 2 - position[:, 0] ** 2)
        low, top = -inside, inside
    else:
        low, top = np.zeros(len(position)), np.full(len(position), high[-1])
    return tuple(position + ((face - position[:, axis]) / scene.way[axis])[:, None] * scene.way for face in (low, top))


def _axes(way: np.ndarray) -> np.ndarray:
    first = np.cross(way, [0.0, 0.0, 1.0]) if abs(way[2]) < 0.9 else np.cross([0.0, 1.0, 0.0], way)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(way, first)])


def _moved(position: np.ndarray, start: np.ndarray, way: np.ndarray) -> np.ndarray:
    path = position - start
    return path - np.sum(path * way, axis=1, keepdims=True) * way


def _of(found, x: np.ndarray, rays) -> np.ndarray:
    """Return the places in the pupil of the rays whose changes are known."""
    from scipy.spatial import cKDTree

    return x[cKDTree(rays.position).query(found.start)[1]]
