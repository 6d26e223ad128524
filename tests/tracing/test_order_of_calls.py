"""Answers do not depend on what was computed before, or meanwhile, on the same fields, rays, pupils and bodies.

Each pair of calls is drawn at random: two fields on the same nodes, with or without a body, bundles of which some share
the rays of their pilots, pupils, stops, tolerances and engines. The second call, and of two calls at once both, must
have the plan and the bits of the same call on objects made anew.
"""

import gc
import threading
from typing import Any

import numpy as np
import pytest

from aerokernels import (
    Annulus,
    Body,
    Disc,
    IndexField,
    Plane,
    RayBundle,
    estimate_strehl,
    prepare_strehl,
    trace,
    wavefront,
)

from .backends import WAVE

pytestmark = pytest.mark.slow

RAYS = 10_000  # enough for a bundle to be interpolated, and for its extent to be examined by some of them
DISC = Disc(2e-3, (0.0, 0.0, -1e-3))
OUTPUTS = ("opd", "direction", "step_error", "status")


class World:
    """Objects that calls share, from the numbers of a seed."""

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        kind = ("planar", "axisymmetric", "volume")[seed % 3]
        y, z = np.linspace(-5e-3 if kind != "axisymmetric" else 0.0, 5e-3, 21), np.linspace(0.0, 20e-3, 49)
        axes = np.meshgrid(*([y] * (2 if kind == "volume" else 1)), z, indexing="ij")
        self.body = None
        if kind == "planar" and seed % 2:
            self.body = Body(np.array([(-2e-3, 1e-3), (2e-3, 1e-3), (0.4e-3, 5e-3), (-0.4e-3, 5.5e-3)]), "planar")
        self.fields = []
        for _ in range(2):
            place = rng.uniform(-1e-3, 1e-3)
            size = sum((axis - place) ** 2 for axis in axes[:-1]) / rng.uniform(1e-3, 3e-3) ** 2
            along = (axes[-1] - 10e-3) / rng.uniform(1.5e-3, 4e-3)
            waves = 1.0 + 0.1 * np.cos(2.0 * np.pi * axes[-1] / rng.uniform(8e-4, 3e-3)) * (axes[0] > place)
            contrast = 10.0 ** rng.uniform(-6, -4.5) * np.exp(-size - along**2) * waves
            origin, spacing = [axis.ravel()[0] for axis in axes], [y[1] - y[0]] * (len(axes) - 1) + [z[1] - z[0]]
            made = IndexField.from_samples(contrast, origin=origin, spacing=spacing, geometry=kind, body=self.body)
            self.fields.append(made)
        start = np.c_[rng.uniform(-1e-3, 1e-3, RAYS), rng.uniform(-2e-3, 0.0, RAYS), np.full(RAYS, -1e-3)]
        other = start.copy()
        rest = np.setdiff1d(np.arange(RAYS), np.linspace(0, RAYS - 1, 512).round().astype(int))
        other[rest, 1] = rng.uniform(0.0, 2.5e-3, len(rest))
        way = np.c_[rng.normal(0.0, 0.03, (RAYS, 2)), np.ones(RAYS)]
        inside = np.c_[np.zeros(RAYS), rng.uniform(-3e-3, 3e-3, RAYS), rng.uniform(1.2e-3, 5e-3, RAYS)]
        self.rays = [RayBundle(each, way) for each in (start, other, inside)]
        self.rays += [RayBundle.collimated(DISC, RAYS, seed=each) for each in (1, 2)]
        self.pupils = [DISC, Annulus(2e-3, 0.7e-3, (0.0, 0.0, -1e-3))]


def drawn(rng: np.random.Generator) -> dict[str, Any]:
    """A call at random."""
    doors = ["trace", "trace", "estimate", "with_field", "wavefront"]
    return {
        "door": str(rng.choice(doors)),
        "places": rng.integers(10, size=3).tolist(),
        "tolerance": float(rng.choice([1e-3, 1e-2])),
        "tilt": float(rng.choice([0.0, 0.1])),
        "bundle": str(rng.choice(["auto", "off"])),
        "seed": int(rng.integers(2)),
    }


def answer(world: World, call: dict[str, Any]) -> list[Any]:
    """The plan and the bits of a call's answer, or the words of its refusal."""
    here, through, there = call["places"]
    field, rays, other = world.fields[here % 2], world.rays[through % 5], world.fields[there % 2]
    pupil, options = world.pupils[through % 2], {"tolerance": call["tolerance"], "wavelength": WAVE}
    try:
        if call["door"] == "trace":
            until = Plane((0.0, 0.0, 25e-3), (0.0, call["tilt"], 1.0))
            found = trace(field, rays, until=until, bundle=call["bundle"], outputs=OUTPUTS, **options)
            return [repr(found.plan), *(np.asarray(getattr(found, name)).tobytes() for name in OUTPUTS)]
        if call["door"] == "wavefront":
            seen = wavefront(field, pupil, pixel_count=16, **options)
            return [repr(seen.plan), seen.opd.tobytes(), seen.strehl()]
        options |= {"ray_count": 4096, "bundle": call["bundle"], "allow_truncation": True}
        if call["door"] == "estimate":
            made = [estimate_strehl(field, pupil, seed=call["seed"], **options)]
        else:
            prepared = prepare_strehl(field, pupil, **options)
            made = [prepared.with_field(other)(call["seed"]), prepared(call["seed"])]
        return [value for each in made for value in (repr(each.plan), each.value, each.standard_error, each.opd_rms)]
    except ValueError as fault:
        return [str(fault)]


def alone(seed: int, call: dict[str, Any]) -> list[Any]:
    """The answer on objects made anew, when all others are gone."""
    gc.collect()
    return answer(World(seed), call)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("at_once", [False, True], ids=["in order", "at once"])
@pytest.mark.parametrize("seed", range(15))
def test_pairs_of_calls_answer_as_each_alone(seed: int, at_once: bool):
    """Two thirds of the second calls are neighbours of the first: the same but for a few of its choices."""
    rng = np.random.default_rng([seed, at_once])
    first, second = drawn(rng), drawn(rng)
    if seed % 3:
        second = {**first, "places": second["places"], "tilt": second["tilt"], "bundle": second["bundle"]}
    found: dict[int, list] = {}

    def work(world: World, number: int, call: dict[str, Any]) -> None:
        found[number] = answer(world, call)

    world = World(seed)
    threads = [threading.Thread(target=work, args=(world, *each)) for each in enumerate((first, second))]
    for thread in threads:
        thread.start()
        if not at_once:
            thread.join()
    for thread in threads:
        thread.join()
    del world, threads, thread
    for number, call in ((1, second), (0, first))[: 1 + at_once]:
        assert found[number] == alone(seed, call), (first, second)


def test_a_plan_is_of_all_rays_not_of_its_pilot():
    """Set-up: two bundles with the same pilot; the air that only the second one meets is rough. It plans for itself."""
    y, z = np.linspace(-4e-3, 4e-3, 33), np.linspace(0.0, 40e-3, 129)
    x, y_, z_ = np.meshgrid(y, y, z, indexing="ij")
    along = z_ - 20e-3
    smooth = 4e-6 * np.exp(-(((x + 2e-3) / 1.2e-3) ** 2) - (y_ / 1.5e-3) ** 2 - (along / 6e-3) ** 2)
    rough = 2e-6 * np.exp(-(((x - 2.5e-3) / 6e-4) ** 2) - (y_ / 1.5e-3) ** 2 - (along / 5e-3) ** 2)
    rng, far = np.random.default_rng(0), Plane((0.0, 0.0, 45e-3), (0.0, 0.0, 1.0))
    one = np.c_[rng.uniform(-3e-3, -1.6e-3, RAYS), rng.uniform(-1e-3, 1e-3, RAYS), np.full(RAYS, -1e-3)]
    rest = np.setdiff1d(np.arange(RAYS), np.linspace(0, RAYS - 1, 512).round().astype(int))
    two = one.copy()
    two[rest, 0] = rng.uniform(2.3e-3, 2.7e-3, len(rest))

    def air() -> IndexField:
        contrast = smooth + rough * np.cos(2.0 * np.pi * along / 1e-3)
        spacing = (y[1] - y[0], y[1] - y[0], z[1] - z[0])
        return IndexField.from_samples(contrast, origin=(y[0], y[0], 0.0), spacing=spacing, geometry="volume")

    options = {"until": far, "bundle": "off", "wavelength": WAVE, "outputs": ("opd",)}
    used = air()
    before = trace(used, RayBundle(one, [[0.0, 0.0, 1.0]]), **options)
    after, anew = (trace(each, RayBundle(two, [[0.0, 0.0, 1.0]]), **options) for each in (used, air()))
    assert after.plan == anew.plan and after.plan.sample_count != before.plan.sample_count
    assert np.array_equal(after.opd, anew.opd)
