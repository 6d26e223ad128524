"""Numbers and shapes that no flow, medium, echo, picture or series has, each refused in words."""

import math

import numpy as np
import pytest
import xarray

from aerokernels import (
    Body,
    DensityField,
    Disc,
    IndexField,
    QuadMesh,
    RayBundle,
    SolidBody,
    Wavefront,
    strehl,
)
from aerokernels.benches.bench import Bench
from aerokernels.benches.picture import Picture
from aerokernels.flow import open_series
from aerokernels.flow.gas import isentropic, tunnel_conditions
from aerokernels.flow.sampled_density import GridDensity
from aerokernels.inputs.checks import as_waveform
from aerokernels.series.time_statistics import statistics

SQUARE = QuadMesh.structured(*np.meshgrid([0.0, 1.0], [0.0, 1.0], indexing="ij"), "planar")
CUBE = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 3)
HALF = np.full((9, 9), 2e-8, dtype=np.float16)
ON_A_GPU = 2  # DLPack's number of the memory of a CUDA device
PLANAR = Body(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), "planar")


class OnlyDlpack:
    """An array of a library that has DLPack and nothing else, in a kind of memory."""

    def __init__(self, array: np.ndarray, memory: int = 1):
        self.array, self.memory = array, memory

    def __dlpack__(self, **options):  # noqa: D105
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):  # noqa: D105
        return self.memory, 0


def grid(shape=(3, 3), **changes):
    given = {"origin": (0.0, 0.0), "spacing": (1.0, 1.0), "geometry": "planar", "ambient_density": 1.2, **changes}
    return GridDensity(given.pop("density", np.ones(shape)), **given)


def labelled(coordinates) -> xarray.DataArray:
    return xarray.DataArray(
        np.zeros([len(c) for c in coordinates.values()]), coords=coordinates, dims=list(coordinates)
    )


def samples(contrast, **changes):
    shape = np.shape(contrast)
    given = {"origin": [0.0] * len(shape), "spacing": [1.0] * len(shape), "geometry": "planar", **changes}
    return IndexField.from_samples(contrast, **given)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: isentropic(-1.0), r"mach must be zero or positive, got -1\.0"),
        (lambda: tunnel_conditions(3.0, 0.63, 288.0), "0.63 Pa is too low for a tunnel: give pascals, 630e3 for"),
        (lambda: tunnel_conditions(3.0, 630e3, 15.0), "15 K is too low for a gas: give kelvins, 288 for 15 degC"),
        (lambda: grid((3, 3, 3)), r"a planar field cannot have densities of shape \(3, 3, 3\)"),
        (lambda: grid(density=np.full((3, 3), 5000.0)), "9 of 9 densities on the grid are too great for a gas"),
        (lambda: grid(density=-np.ones((3, 3))), "9 of 9 densities on the grid are not positive"),
        (lambda: grid(body=Body(PLANAR.profile, "axisymmetric")), "the body is axisymmetric, the field planar"),
        (lambda: samples(np.zeros((3, 3))).contrast_at([[0.0, 1.0]]), r"points must have shape \(n, 3\)"),
        (lambda: IndexField.from_xarray(labelled({"y": [0.0, 1.0], "z": [1.0, 2.0]}).drop_vars("y")),
         "dimension y has no coordinates"),
        (lambda: IndexField.from_xarray(labelled({"y": [0.0, 1.0], "z": [1.0]})), "dimension z has 1 nodes"),
        (lambda: SolidBody(CUBE, np.array([[0, 1, 2]])), "at least four triangles"),
        (lambda: SolidBody.of_revolution(PLANAR), "needs an axisymmetric profile"),
        (lambda: samples(np.zeros((3, 3))).resample([0.1, 0.1, 0.1]), "spacing must be one number or 2"),
        (lambda: as_waveform(np.arange(9.0), np.ones(9)), "give seconds, 1e-9 for 1 ns"),
        (lambda: Bench(0.001, -1.0), "focal_length = -1.0: give a positive length"),
        (lambda: Bench(1.0, 1.0), "a source of 1 rad is too large"),
        (lambda: Bench(0.001, 1.0, "star"), "source 'star' is not known"),
        (lambda: Bench(0.001, 1.0, focus=math.nan), "focus = nan: give the plane in focus"),
        (lambda: open_series([], time=[]), "the series is empty"),
        (lambda: open_series([np.ones((3, 3))], time=[0.0]), "arrays need to know where they lie"),
        (lambda: open_series([np.ones((3, 3))], time=[math.inf], geometry="planar", origin=(0, 0), spacing=(1, 1),
                             ambient_density=1.2), "must be finite numbers, in seconds"),
        (lambda: open_series([np.ones((3, 3))], time=[0.0], geometry="planar", origin=(0, 0), spacing=(1, 1)),
         "arrays need an ambient_density"),
        (lambda: open_series([np.ones((3, 3))], time=[0.0], species=True), "taken for arrays, which take no species"),
        (lambda: statistics(xarray.Dataset()), r"no opd over \(time, y, x\)"),
        (lambda: samples(np.full((4, 4), 7e-5, dtype=np.float16)), "contrast is float16, whose least digit is 6e-8"),
        (lambda: strehl(HALF, 905e-9), "opd is float16, which has three digits at most: give float32"),
        (lambda: strehl(OnlyDlpack(HALF), 905e-9), "opd is float16"),
        (lambda: Wavefront(HALF, np.ones((9, 9)), 1e-3, 905e-9), "opd is float16"),
        (lambda: Wavefront.from_samples(np.ones((99, 2)), HALF, Disc(1.0), 905e-9), "opd is float16"),
        (lambda: RayBundle(np.zeros((3, 3), np.float16), [0.0, 0.0, 1.0]), "position is float16"),
        (lambda: RayBundle(np.zeros((3, 3)), np.ones((3, 3), np.float16)), "direction is float16"),
        (lambda: grid(density=np.ones((3, 3), np.float16)), "density is float16"),
        (lambda: RayBundle([*np.zeros((3, 3), np.float16)], [0.0, 0.0, 1.0]), "an entry of position is float16"),
        (lambda: Disc(1.0, center=(np.float16(0.1), 0.0, 0.0)), "an entry of center is float16"),
        (lambda: RayBundle([[0.0, 0.0, 0.0], np.ma.array([0.0, 9.0, 0.0], mask=[0, 1, 0])], [0.0, 0.0, 1.0]),
         "1 of the 3 numbers of an entry of position are masked"),
    ],
)  # fmt: skip
def test_values(made, told):
    with pytest.raises(ValueError, match=told):
        made()


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: samples(np.array([["a", "b"], ["c", "d"]])), "contrast must be an array of real numbers"),
        (lambda: Wavefront.from_samples(np.ones((9, 2)), np.ones(9) * 1j, Disc(1.0), 905e-9), "which is complex"),
        (lambda: strehl(OnlyDlpack(np.ones(9), ON_A_GPU), 905e-9), "opd is a OnlyDlpack that NumPy cannot read: copy"),
        (lambda: Bench(0.001, 1.0, sensor=3), "sensor must be a Sensor, got int"),
        (lambda: open_series(3), "a series is opened from a path"),
        (lambda: open_series([np.ones(4)], time=[0.0], mesh=3), "mesh must be a QuadMesh, got int"),
        (lambda: statistics(3), r"dataset must be an xarray.Dataset|dataset must be"),
    ],
)
def test_kinds(made, told):
    with pytest.raises(TypeError, match=told):
        made()


def test_arrays_with_dlpack_alone_are_read():
    step = 0.2e-6 * (np.arange(100) < 30)
    assert strehl(OnlyDlpack(step), wavelength=905e-9, weights=OnlyDlpack(np.ones(100))) == strehl(step, 905e-9)


def test_the_snapshots_of_a_series_are_asked_for_by_whole_numbers():
    series = open_series(
        [np.ones((3, 3)), np.ones((3, 4))], time_step=1.0, geometry="planar", origin=(0, 0), spacing=(1, 1),
        ambient_density=1.2,
    )  # fmt: skip
    assert isinstance(series[-2], DensityField) and series.lies_here(series[0])
    assert not series.lies_here(grid((4, 3))) and not series.lies_here(grid(body=PLANAR))
    with pytest.raises(TypeError, match="indexed by whole numbers, got True"):
        series[True]
    with pytest.raises(IndexError, match="snapshot 2 of a series of 2"):
        series[2]
    with pytest.raises(ValueError, match=r"snapshot 1 has shape \(3, 4\), the first one \(3, 3\)"):
        series[1]


@pytest.mark.parametrize("picture", [np.ones(3), np.full((2, 2), np.nan)])
def test_a_picture_is_a_plane_of_brightness(picture):
    with pytest.raises(ValueError, match="a picture must be a two-axis array of finite"):
        Picture(picture, np.arange(2.0), np.arange(2.0))


@pytest.mark.parametrize("given", [b"a.nc", 3, "a\0.nc"])
def test_paths_are_texts_or_path_like(given):
    """Expected of every way in: the argument's name, in words; bytes, numbers and zero characters ended in Python's."""
    from aerokernels import flow, sweep
    from aerokernels.benches.picture import read_picture
    from aerokernels.hardware.simulator import EchoSource
    from aerokernels.hardware.store import EchoStore

    ways = [
        lambda: EchoStore(given),
        lambda: EchoSource.from_result(given),
        lambda: read_picture(given, pixel_size=1e-3, nose=(1.0, 1.0)),
        lambda: sweep("wind-tunnel-mach3", vary={"target.tilt": [0.0]}, out=given),
        *([] if given == 3 else [lambda: flow.open_series(given)]),
    ]
    for way in ways:
        with pytest.raises((TypeError, ValueError), match=r"^(path|out|source) (must be a text or a Path, got|is 'a)"):
            way()
