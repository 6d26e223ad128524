"""Rays and results that stay on a device of Warp's: made there, taken from other libraries, given out without a copy.

On Warp's CPU device the same code runs as on a GPU; only there is memory pinned, and only there do libraries say
`__cuda_array_interface__`.
"""

import pickle
import warnings

import numpy as np
import pytest

from aerokernels import Annulus, Disc, IndexField, Mask, Plane, RayBundle, Rectangle, trace
from aerokernels.device_arrays import DeviceArray, plain_array
from aerokernels.device_arrays.rays import checked_rays
from aerokernels.tracing import RayStatus

from ..backends import ENGINES, WARP, WAVE, on

COUNT = 12_000  # rays that are delivered as a bundle
SPACING = 1e-4
AXIS = (np.arange(24) - 11.5) * SPACING
X, Y, Z = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")
SMOOTH = 3e-4 * np.exp(-(X**2 + Y**2 + Z**2) / 4e-4**2) * np.cos(X / 1e-3 + 0.3)
PUPIL = Disc(8e-4, (0.0, 0.0, -2e-3))
FAR = Plane((0.0, 0.0, 2e-3), (0.0, 0.1, 1.0))
SLANTED = (0.05, -0.03, 1.0)
PUPILS = {
    "disc": PUPIL,
    "annulus": Annulus(8e-4, 3e-4, (0.0, 1e-4, -2e-3), (0.1, 0.0, 1.0)),
    "rectangle": Rectangle(1e-3, 6e-4, (0.0, 0.0, -2e-3)),
    "mask": Mask(np.array([[0.2, 1.0], [0.0, 0.7]]), 4e-4, (0.0, 0.0, -2e-3)),
}


def volume(contrast=SMOOTH) -> IndexField:
    return IndexField.from_samples(
        contrast, origin=(AXIS[0],) * 3, spacing=(SPACING,) * 3, geometry="volume", wavelength=WAVE
    )


def device_of(engine: str) -> str:
    return on(engine)["device"]


def as_warp(values, device: str):
    """An array of another library's, as far as this package knows: Warp's numbers on a device."""
    import warp as wp

    return wp.array(np.array(values), dtype=wp.float64, device=device)


def taken(position, direction) -> RayBundle:
    """The bundle of arrays that lie on a device, even on the CPU, whose arrays would come as NumPy's by themselves."""
    found = RayBundle(np.zeros((1, 3)), np.ones((1, 3)))
    for name, array in zip(("position", "direction"), checked_rays(position, direction), strict=True):
        object.__setattr__(found, name, array)
    object.__setattr__(found, "weight", np.full(len(position), 1.0 / len(position)))
    return found


def same(one: np.ndarray, other: np.ndarray, limit: float) -> bool:
    return one.shape == other.shape and bool(np.abs(one - other).max() <= limit)


@pytest.mark.parametrize("engine", WARP)
@pytest.mark.parametrize("kind", PUPILS)
def test_rays_made_on_a_device_are_those_made_on_the_host(engine, kind):
    pupil, device = PUPILS[kind], device_of(engine)
    for sampling in ("sobol", "grid") if kind == "disc" else ("sobol",):
        choices = {"ray_count": 500, "sampling": sampling, "seed": 5}
        for given in ({}, {"direction": SLANTED}):
            here = RayBundle.collimated(pupil, **choices, **given)
            there = RayBundle.collimated(pupil, **choices, **given, device=device)
            assert there.device == device
            assert same(there.position, here.position, 1e-17)  # some roundings of a pupil of a millimetre
            assert np.array_equal(there.direction, here.direction)
            assert same(there.weight, here.weight, 1e-15)
        for toward in (False, True):
            apex = {"from_point": (1e-4, 0.0, -9e-3), "toward_point": toward}
            here, there = (RayBundle.through(pupil, **choices, **apex, **more) for more in ({}, {"device": device}))
            assert same(there.position, here.position, 1e-17)
            assert same(there.direction, here.direction, 1e-15)
        if kind == "disc":
            cone = {"apex": (0.0, 0.0, -3e-3), "axis": SLANTED, "half_angle": 0.3, **choices}
            here, there = (RayBundle.divergent(**cone, **more) for more in ({}, {"device": device}))
            assert same(there.position, here.position, 0.0)
            assert same(there.direction, here.direction, 4e-16)


def test_a_device_that_is_not_there_is_refused_by_name():
    with pytest.raises(ValueError, match=r"device 'cuda:17' does not exist: rays can be made on .*cpu"):
        RayBundle.collimated(PUPIL, 16, device="cuda:17")


@pytest.mark.parametrize("engine", WARP)
@pytest.mark.parametrize("rays", ["collimated", "incoherent"])
def test_rays_on_a_device_are_traced_there_and_stay_there(engine, rays):
    """Bit by bit what the host's rays give, by a bundle and ray by ray; neither starts nor results come to the host."""
    choices, field = on(engine), volume()
    device, count = choices["device"], COUNT if rays == "collimated" else 300
    if rays == "collimated":
        there = RayBundle.collimated(PUPIL, count, direction=SLANTED, device=device)
    else:
        place = RayBundle.collimated(PUPIL, count)
        way = np.c_[np.random.default_rng(2).normal(0.0, 0.05, (count, 2)), np.ones(count)]
        there = taken(as_warp(place.position, device), as_warp(way, device))
    found = trace(field, there, until=FAR, **choices)
    assert (found.plan.bundle is not None) == (rays == "collimated")
    if rays == "collimated":
        assert there.held("position")._host is None and there.held("direction")._host is None
    for name in ("opd", "direction", "traced_status", "step_count", "start_position"):
        assert isinstance(found.__dict__[name], DeviceArray) and found.__dict__[name]._host is None, name
    here = trace(field, RayBundle(there.position, there.direction), until=FAR, **choices)
    for name in ("opd", "direction", "position", "optical_path", "step_count", "status", "start_position"):
        assert np.array_equal(getattr(found, name), getattr(here, name)), name
    assert found.ok.all() and found.ray_count == len(found.opd) == count


@pytest.mark.parametrize("engine", ENGINES)
def test_parallel_rays_hold_their_direction_once(engine, monkeypatch):
    """Equal directions are one row in memory; each ray is traced as beside one that goes another way."""
    pytest.importorskip("pyopencl")
    from aerokernels.tracing.engines.opencl import engine as opencl

    monkeypatch.setattr(opencl, "REPEATED", 64)
    place = RayBundle.collimated(PUPIL, 500).position
    for given in ([SLANTED], np.repeat([SLANTED], 500, axis=0)):
        rays = RayBundle(place, given)
        assert rays.direction.shape == (500, 3) and rays.direction.strides[0] == 0
    assert rays[3:9].direction.strides[0] == 0 and np.array_equal(
        pickle.loads(pickle.dumps(rays)).direction, rays.direction
    )
    mixed = RayBundle(np.r_[place, place[:1]], np.r_[rays.direction, [(0.0, 0.1, 1.0)]])
    assert mixed.direction.strides[0] == 24
    found, beside = (trace(volume(), each, until=FAR, **on(engine)) for each in (rays, mixed))
    for name in ("opd", "direction", "position", "status", "start_direction"):
        assert np.array_equal(getattr(found, name), getattr(beside, name)[:500]), name
    with pytest.raises(ValueError, match="500 ray directions are zero, the first is ray 0"):
        RayBundle(place, np.zeros((1, 3)))


@pytest.mark.parametrize("engine", ENGINES)
def test_results_are_given_out_by_dlpack_and_read_as_numpy(engine):
    rays = RayBundle.collimated(PUPIL, 40, direction=SLANTED)
    found = trace(volume(), rays, until=FAR, outputs=("opd", "direction"), **on(engine))
    import warp as wp

    for name, shape in (("opd", (40,)), ("direction", (40, 3)), ("status", (40,)), ("start_position", (40, 3))):
        given = found.on_device(name)
        read = getattr(found, "traced_status" if name == "status" else name)
        assert isinstance(read, np.ndarray) and read.shape == shape, name
        if isinstance(given, np.ndarray) and not given.flags.writeable:
            given = given.copy()  # NumPy gives no read-only array out
        assert np.array_equal(wp.from_dlpack(given).numpy(), read), name
        assert hasattr(given, "__cuda_array_interface__") == (engine == "warp-gpu" and given.__class__ is wp.array)
    for wrong in ("position", "opds", "plan"):
        with pytest.raises(ValueError, match=f"'{wrong}' is not among the outputs: this result has"):
            found.on_device(wrong)
    copy = pickle.loads(pickle.dumps(found))
    assert np.array_equal(copy.opd, found.opd) and np.array_equal(copy.on_device("opd"), found.opd)


@pytest.mark.parametrize("engine", WARP)
def test_rejected_rays_are_traced_again_on_the_device_as_on_the_host(engine):
    """A tolerance that float32 does not hold: rays are traced again, and written where the others stay."""
    choices = on(engine) | {"tolerance": 1e-7, "method": "adaptive"}
    there = RayBundle.collimated(PUPIL, 60, direction=SLANTED, device=choices["device"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = trace(volume(), there, until=FAR, **choices)
        here = trace(volume(), RayBundle(there.position, there.direction), until=FAR, **choices)
        exact = trace(volume(), there, until=FAR, **choices | {"precision": "float64"})
    assert isinstance(found.__dict__["opd"], DeviceArray)
    assert np.array_equal(found.opd, here.opd) and np.array_equal(found.status, here.status)
    held = found.traced_status == RayStatus.OK
    assert held.sum() > 40 and np.abs(found.opd - exact.opd)[held].max() < 2e-7 * WAVE


class OnlyDLPack:
    """What has nothing but DLPack."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):  # noqa: D105
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):  # noqa: D105
        return self.array.__dlpack_device__()


def test_fields_and_rays_of_another_library_on_the_host():
    import warp as wp

    place, way = RayBundle.collimated(PUPIL, 9).position, np.array([[0.1, 0.0, 1.0]])
    expected, field = RayBundle(place, way), volume()
    for wrap in (OnlyDLPack, lambda array: wp.array(array, device="cpu")):
        found = RayBundle(wrap(np.array(place)), wrap(way))
        assert found.device is None and np.array_equal(found.position, expected.position)
        assert np.array_equal(found.direction, expected.direction)
        assert np.array_equal(volume(wrap(SMOOTH)).samples.samples, field.samples.samples)
    assert plain_array(OnlyDLPack(SMOOTH)).ctypes.data == SMOOTH.ctypes.data  # no copy on the way


@pytest.mark.parametrize("library", ["torch", "jax"])
def test_libraries_read_results_and_give_fields(library):
    module = pytest.importorskip(library)
    rays = RayBundle.collimated(PUPIL, 9, direction=SLANTED)
    if library == "torch":
        tensors, read = [module.tensor(each) for each in (SMOOTH, rays.position, rays.direction)], module.from_dlpack
    else:
        module.config.update("jax_enable_x64", True)
        tensors = [module.numpy.asarray(each) for each in (SMOOTH, rays.position, rays.direction)]
        read = module.numpy.from_dlpack
    choices = {"until": FAR, **on("warp-cpu")}
    found = trace(volume(tensors[0]), RayBundle(*tensors[1:]), **choices)
    assert np.array_equal(found.opd, trace(volume(), rays, **choices).opd)
    assert np.array_equal(np.asarray(read(found.on_device("opd"))), found.opd)


@pytest.mark.gpu
def test_rays_and_fields_on_a_gpu_go_the_way_of_the_gpu():
    """Arrays of a CUDA device, by both protocols: the rays are traced there by Warp though OpenCL goes before it."""
    import warp as wp

    device = device_of("warp-gpu")
    place = np.array(RayBundle.collimated(PUPIL, COUNT, seed=4).position)
    field = volume(wp.array(SMOOTH, dtype=wp.float64, device=device))
    assert np.array_equal(field.samples.samples, volume().samples.samples)
    for position in (wp.array(place, dtype=wp.float64, device=device), wp.array(place, dtype=wp.vec3d, device=device)):
        there = RayBundle(position, np.array([SLANTED]))
        assert there.device == device
        found = trace(field, there, until=FAR)
        assert found.plan.backend == "warp" and found.plan.device == device
        assert there.held("position")._host is None and found.__dict__["opd"]._host is None
        opd = found.on_device("opd")
        assert opd.__cuda_array_interface__["shape"] == (COUNT,) and opd.__cuda_array_interface__["data"][0] == opd.ptr
        assert wp.from_dlpack(opd).ptr == opd.ptr
        here = trace(field, RayBundle(place, [SLANTED]), until=FAR, **on("warp-gpu"))
        assert np.array_equal(found.opd, here.opd) and np.array_equal(found.direction, here.direction)


@pytest.mark.gpu
def test_many_rays_come_and_go_through_pinned_memory():
    """Brought chunk by chunk while others are traced, and fetched at once: the rays that were made on the device."""
    from aerokernels.tracing.engines.warp.engine import MANY

    choices, count = on("warp-gpu"), 3 * MANY + 1234
    there = RayBundle.collimated(PUPIL, count, direction=SLANTED, device=choices["device"])
    position = np.array(there.position)
    kept = there.position[1:]  # a view keeps the memory, whatever else is gone
    first = kept.copy()
    # Parallel rays, whose direction comes once, and others, of which some are not delivered by the bundle.
    for toward in (None, (0.0, 0.0, 9e-3)):
        here = RayBundle(position, [SLANTED] if toward is None else toward - position)
        rays = (
            there if toward is None else RayBundle(*map(as_warp, (position, here.direction), 2 * [choices["device"]]))
        )
        found, read = (trace(volume(), each, until=FAR, **choices) for each in (rays, here))
        for name in ("opd", "position", "direction", "step_count", "status"):
            assert np.array_equal(getattr(found, name), getattr(read, name)), name
    del found, read
    again = trace(volume(), here, until=FAR, **choices)
    assert again.ok.all() and np.array_equal(kept, first)
    for _ in range(8):  # dropped while they are on their way
        trace(volume(), here, until=FAR, **choices)
    assert np.array_equal(again.opd, trace(volume(), here, until=FAR, **choices).opd)
