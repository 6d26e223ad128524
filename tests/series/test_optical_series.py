"""OPD in time against fields whose line integrals are closed forms; stores that are broken off."""

import os
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from aerokernels import Disc, estimate_strehl, flow, optical_series
from aerokernels.flow import GridMesh
from aerokernels.series.line_integrals import LineIntegrals, NotLinearError
from aerokernels.tracing.pupil.air import TruncationWarning
from aerokernels.wavefronts import remove_terms

from .fourier import CONSTANT, WAVELENGTH, Fourier

SHAPE, SPACING, ORIGIN = (41, 41, 31), 2.5e-3, (-0.05, -0.05, 0.0)
TIME = np.arange(4) * 1e-5
Z0 = 0.004


def opened(field: Fourier, times=TIME) -> flow.Series:
    arrays = [field.on_grid(ORIGIN, SPACING, SHAPE, t) for t in times]
    options = {"geometry": "volume", "origin": ORIGIN, "spacing": [SPACING] * 3, "ambient_density": field.mean}
    return flow.open_series(arrays, time=times, **options)


def exact(field: Fourier, found: xarray.Dataset, direction, time: float, remove) -> np.ndarray:
    """The exact map of the pixels with a weight, terms removed; coordinates are across the look direction."""
    lit = found.weight.values > 0.0
    x, y = (axis[lit] for axis in np.meshgrid(found.x, found.y))
    first, second = np.reshape(found.attrs["pupil_axes"], (2, 3))
    start = found.attrs["pupil_center"] + x[:, None] * first + y[:, None] * second
    assert np.abs(start[:, 2] - Z0).max() < 1e-15
    length = (ORIGIN[2] + SPACING * (SHAPE[2] - 1) - Z0) / direction[2]
    opd = field.opd(start, direction, np.full(x.size, length), time)
    return remove_terms(opd, remove, start[:, :2], found.weight.values[lit])


@pytest.mark.parametrize(
    ("direction", "remove"), [((0.0, 0.0, 1.0), ("piston",)), ((0.15, 0.1, 1.0), ("piston", "tilt"))]
)
def test_a_frozen_field_carried_past_a_pupil_gives_the_shifted_map(direction, remove):
    """Set-up: 12 modes of 60 rad/m on nodes 2.5 mm apart, carried at 300 m/s. Expected: the exact integral, shifted.

    Error: the spline's, (k h)^4 / 720 ~ 1e-6 to 1e-4 of the amplitude for the fastest modes, and the bending's
    1/2 L theta^2: both are in `error`, which is the tolerance; nearest-neighbour sums are worse by 30 times and more.
    """
    field = Fourier.random(1)
    along = np.array(direction) / np.linalg.norm(direction)
    found = optical_series(opened(field), Disc(0.02, [0.0, 0.0, Z0]), direction=along, remove=remove, pixel_count=32)
    lit = found.weight.values > 0.0
    assert found.opd.dims == ("time", "y", "x") and set(found.strehl.dims) == {"time"}
    assert np.isnan(found.opd.values[:, ~lit]).all() and not found.valid.values[:, ~lit].any()
    weight = found.weight.values[lit]
    for number, t in enumerate(TIME):
        truth = exact(field, found, along, t, remove)
        off = np.sqrt(weight @ (found.opd.values[number][lit] - truth) ** 2)
        rms = np.sqrt(weight @ truth**2)
        assert rms > 1e-8 and off < float(found.error[number]) < 1e-3 * WAVELENGTH
        assert float(found.strehl[number]) == pytest.approx(
            abs(weight @ np.exp(2j * np.pi / WAVELENGTH * truth)) ** 2, abs=1e-3
        )
        assert off < 1e-3 * rms
    assert not found.traced.any()


@pytest.mark.parametrize("turned", [0.0, 0.15])
def test_a_moving_vortex(turned: float):
    """Set-up: a core of low density 12 mm wide across the line of sight, rho = rho_0 - A exp(-r^2 / w^2), at 300 m/s.

    Expected: -K A sqrt(pi) w / 2 exp(-across^2 / w^2) (erf(ahead / w) - erf(behind / w)), carried on, within `error`.
    """
    from scipy.special import erf

    width, depth, mean, middle = 0.012, 0.05, 0.5, 0.037
    grid = [ORIGIN[k] + SPACING * np.arange(SHAPE[k]) for k in range(3)]
    x, _, z = np.meshgrid(*grid, indexing="ij")
    core = [300.0 * t - 0.01 for t in TIME]
    arrays = [mean - depth * np.exp(-((x - c) ** 2 + (z - middle) ** 2) / width**2) for c in core]
    options = {"geometry": "volume", "origin": ORIGIN, "spacing": [SPACING] * 3, "ambient_density": mean}
    along = np.array([np.sin(turned), 0.0, np.cos(turned)])
    found = optical_series(
        flow.open_series(arrays, time=TIME, **options),
        Disc(0.012, [0, 0, Z0]),
        direction=along,
        remove=("piston",),
        pixel_count=24,
    )
    lit = found.weight.values > 0.0
    start = np.meshgrid(found.x, found.y)[0][lit] / along[2]  # in the pupil's plane
    end = (ORIGIN[2] + SPACING * (SHAPE[2] - 1) - Z0) / along[2]
    weight = found.weight.values[lit]
    for number, c in enumerate(core):
        behind = (start - c) * along[0] + (Z0 - middle) * along[2]
        across = (start - c) * along[2] - (Z0 - middle) * along[0]
        truth = erf((behind + end) / width) - erf(behind / width)
        truth *= -0.5 * CONSTANT * depth * np.sqrt(np.pi) * width * np.exp(-((across / width) ** 2))
        truth -= weight @ truth
        off = np.sqrt(weight @ (found.opd.values[number][lit] - truth) ** 2)
        assert off < float(found.error[number]) < 0.02 * np.sqrt(weight @ truth**2)
        exact_ratio = abs(weight @ np.exp(2j * np.pi / WAVELENGTH * truth)) ** 2
        assert abs(float(found.strehl[number]) - exact_ratio) < float(found.strehl_error[number]) < 0.02


@pytest.mark.parametrize(
    ("interpolation", "direction"),
    [("cubic", (0, 0, 1)), ("linear", (0.2, 0.1, -1)), ("cubic", (1, 0.1, 0.2)), ("linear", (0.1, -1, 0))],
)
def test_line_integrals_converge_at_the_order_of_the_interpolant(interpolation: str, direction):
    """Halving the spacing: errors fall by 2^4 or 2^2, less a quarter for not being in the limit."""
    along = np.array(direction) / np.linalg.norm(direction)
    k = np.array([40.0, 30.0, 25.0])
    errors = []
    for halvings in (0, 1):
        spacing, count = 5e-3 / 2**halvings, 40 * 2**halvings + 1
        mesh = GridMesh("volume", [-0.1] * 3, [spacing] * 3, (count,) * 3)
        nodes = -0.1 + spacing * np.arange(count)
        parts = [np.exp(1j * k[axis] * nodes) for axis in range(3)]
        samples = np.einsum("x,y,z->xyz", *parts).real
        start = np.random.default_rng(0).uniform(-0.02, 0.02, (40, 3))
        lines = LineIntegrals(mesh, start, along, interpolation)
        assert lines.inside.all()
        wave = k @ along
        truth = (np.sin(start @ k + wave * lines.length) - np.sin(start @ k)) / wave
        errors.append(np.abs(lines(samples) - truth).max())
    order = {"cubic": 4.0, "linear": 2.0}[interpolation]
    assert errors[0] / errors[1] > 0.75 * 2**order


def test_planar_and_axisymmetric_grids():
    """A parabola in z times cos in r or y: straight along z, and at a slant, against a fine sum."""
    for geometry in ("planar", "axisymmetric"):
        mesh = GridMesh(geometry, [0.0 if geometry == "axisymmetric" else -0.05, 0.0], [1e-3, 1e-3], (101, 41))
        first, z = (mesh.origin[k] + mesh.spacing[k] * np.arange(mesh.shape[k]) for k in range(2))
        samples = np.cos(60.0 * first)[:, None] * (1.0 + 50.0 * z**2)[None, :]
        start = np.random.default_rng(1).uniform(-0.01, 0.01, (20, 3)) + np.array([0.0, 0.0, 0.015])
        for direction in ([0.0, 0.0, 1.0], [0.1, 0.2, 1.0]):
            along = np.array(direction) / np.linalg.norm(direction)
            lines = LineIntegrals(mesh, start, along)
            way = (np.arange(4000) + 0.5) / 4000 * lines.length[:, None]
            points = start[:, None, :] + way[..., None] * along
            across = np.hypot(points[..., 0], points[..., 1]) if geometry == "axisymmetric" else points[..., 1]
            truth = (np.cos(60.0 * across) * (1.0 + 50.0 * points[..., 2] ** 2)).mean(axis=1) * lines.length
            np.testing.assert_allclose(lines(samples), truth, rtol=2e-6)
        with pytest.raises(NotLinearError):
            LineIntegrals(mesh, start, np.array([0.0, 1.0, 0.0]))


def test_a_dense_field_is_traced_where_straight_lines_are_not_good_enough():
    """Density raised until the bending is above the tolerance; "linear" keeps to straight lines."""
    field = Fourier.random(3, amplitude=0.25, wavenumber=90.0)
    field.mean = 6.0
    series, pupil = opened(field, TIME[:2]), Disc(0.02, [0, 0, Z0])
    auto = optical_series(series, pupil, pixel_count=16)
    traced = optical_series(series, pupil, pixel_count=16, method="trace")
    linear = optical_series(series, pupil, pixel_count=16, method="linear")
    assert auto.traced.all() and (auto.probe[0] > 1e-3 * WAVELENGTH) and not linear.traced.any()
    np.testing.assert_array_equal(auto.opd, traced.opd)
    weight = auto.weight
    bending = float(np.sqrt(((linear.opd - traced.opd)[0] ** 2 * weight).sum()))
    assert bending == pytest.approx(float(auto.probe[0]), rel=0.3)  # 128 rays of the pupil's 208
    assert float(linear.error[0]) > bending  # what straight lines leave out is told


def test_the_tilt_of_the_bending_is_in_the_errors_of_boresight_and_rms():
    """Set-up: a wave across a blob whose bending is mostly a tilt, which is removed: the OPD's error is small.

    Expected: boresight and rms with tilt are off by no more than their errors; they were by 8 and 7 times these.
    """
    x, y, z = np.meshgrid(*[np.linspace(-0.02, 0.02, 40)] * 2, np.linspace(0.0, 0.3, 60), indexing="ij")
    density = 1.2 + 0.6 * np.sin(60.0 * x + 0.9) * np.exp(-(((z - 0.15) / 0.05) ** 2)) * np.cos(50.0 * y)
    options = {"geometry": "volume", "origin": [-0.02, -0.02, 0.0], "spacing": [0.04 / 39, 0.04 / 39, 0.3 / 59]}
    series = flow.open_series([density], time=[0.0], ambient_density=1.2, **options)
    pupil = Disc(5e-3, [0.0, 0.0, -0.01])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncationWarning)
        found, traced = (
            optical_series(series, pupil, pixel_count=48, tolerance=1e-2, wavelength=633e-9, method=method).isel(time=0)
            for method in ("auto", "trace")
        )
    assert not found.traced
    for name in ("boresight_x", "boresight_y", "opd_rms", "opd_rms_with_tilt", "strehl"):
        assert abs(found[name] - traced[name]) <= found[f"{name}_error"], name
    assert found.boresight_x_error < 4.0 * abs(found.boresight_x - traced.boresight_x)


@pytest.mark.parametrize(("geometry", "interpolation"), [("planar", None), ("axisymmetric", "conserving")])
def test_snapshots_on_a_mesh_are_straight_lines_too(geometry: str, interpolation: str | None):
    """Cell averages on a mesh of uneven cells, against every ray traced and a closed form."""
    from aerokernels import QuadMesh

    stretch = np.linspace(0.0, 1.0, 41)
    first, z = np.meshgrid(0.02 * stretch**1.2 if geometry == "axisymmetric" else 0.04 * stretch - 0.02,
                           0.02 * stretch + 2e-3 * np.sin(np.pi * stretch), indexing="ij")  # fmt: skip
    mesh = QuadMesh.structured(first, z, geometry)
    centres = mesh.cell_centroid
    densities = [0.5 + 0.01 * np.cos(300.0 * (centres[:, 0] - shift)) for shift in (0.0, 0.002)]
    series = flow.open_series(densities, time=[0.0, 1.0], mesh=mesh, ambient_density=0.5)
    pupil = Disc(5e-3, [0, 0, -1e-3])
    options = {"pixel_count": 8, "remove": ("piston",), "interpolation": interpolation}
    for direction in ((0.0, 0.0, 1.0), (0.05, 0.1, 1.0)):
        found = optical_series(series, pupil, direction=direction, **options)
        traced = optical_series(series, pupil, direction=direction, method="trace", **options)
        assert not found.traced.any() and traced.traced.all()
        scale = float(np.abs(traced.opd).max())
        assert float(np.abs(found.opd - traced.opd).max()) < 0.01 * scale
        assert float(found.probe[0]) < 1e-3 * WAVELENGTH
    if geometry == "planar":
        found = optical_series(series, pupil, **options)
        profile = CONSTANT * 0.02 * 0.01 * np.cos(300.0 * found.y)
        off = found.opd[0].mean("x") - (profile - float((profile * found.weight).sum()))
        assert float(np.abs(off).max()) < 0.02 * float(np.abs(profile).max())


def test_density_fields_on_one_mesh_are_straight_lines_and_others_are_traced():
    """Three fields, the last on a grid of another spacing; a formula; a flow with a body."""

    def field(spacing: float, ambient: float = 0.5) -> flow.GridDensity:
        density = np.full((9, 9, 9), 0.51)
        density[4, 4] = 0.52
        return flow.GridDensity(density, [-4 * spacing] * 3, [spacing] * 3, "volume", ambient)

    series = flow.open_series(iter([field(5e-3), field(5e-3, 0.501), field(4e-3)]), time=[0.0, 1.0, 2.0])
    pupil = Disc(5e-3, [0, 0, -15e-3])
    found = optical_series(series, pupil, pixel_count=8, remove=("piston",))
    assert list(found.traced.values) == [0.0, 0.0, 1.0]
    np.testing.assert_allclose(found.opd[0], found.opd[1], atol=1e-15)
    assert float(found.piston[1] - found.piston[0]) == pytest.approx(-CONSTANT * 1e-3 * 0.035, rel=1e-9)
    drawn = replace(field(5e-3), resampling=SimpleNamespace(column_error=1e-6))  # [kg/m2], as a reader measures it
    told = optical_series(flow.open_series([drawn], time=[0.0]), pupil, pixel_count=8, remove=("piston",))
    assert float(told.error[0] ** 2 - found.error[0] ** 2) == pytest.approx((3.0 * CONSTANT * 1e-6) ** 2, rel=1e-6)
    formula = flow.open_series([flow.cone(3.0, 0.3)] * 2, time=[0.0, 1.0])
    with pytest.raises(ValueError, match="'linear' cannot be had"):
        optical_series(formula, pupil, method="linear")
    body = flow.open_series([flow.shipped("mach3")], time=[0.0])
    with pytest.raises(ValueError, match="past a body"):
        optical_series(body, pupil, method="linear")


RUN = """
import sys, time
sys.path[:0] = [{root!r}]
import numpy as np
from aerokernels import Disc, estimate_strehl, flow, optical_series
from tests.series.fourier import Fourier
field = Fourier.random(4)
def items():
    for k in range(12):
        time.sleep({pause})
        yield field.on_grid((-0.05, -0.05, 0.0), 5e-3, (21, 21, 11), k * 1e-5)
series = flow.open_series(items(), time_step=1e-5, count=12, geometry="volume", origin=[-0.05, -0.05, 0.0],
                          spacing=[5e-3] * 3, ambient_density=0.5)
optical_series(series, Disc(0.02, [0, 0, 0.004]), pixel_count=16, out={out!r})
"""


@pytest.mark.slow
def test_killed_at_any_moment_it_goes_on_bit_for_bit(root: Path, tmp_path: Path):
    """SIGKILL in the middle, and again: the store equals the unbroken one, byte for byte."""
    pytest.importorskip("zarr")

    def run(name: str, pause: float) -> subprocess.Popen:
        code = RUN.format(root=str(root), pause=pause, out=str(tmp_path / name))
        return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, encoding="utf-8", cwd=tmp_path)

    whole = run("whole.zarr", 0.0)
    assert whole.wait(timeout=120) == 0, whole.communicate()
    broken = run("broken.zarr", 0.3)
    done = tmp_path / "broken.zarr" / "done" / "c"
    deadline = time.monotonic() + 120
    while not (done / "4").exists():
        assert broken.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    os.kill(broken.pid, signal.SIGKILL)
    broken.communicate()
    before = {path: path.stat().st_mtime_ns for path in done.glob("[0-4]/0")}
    assert len(before) == 5 and not (done / "11").exists()
    (tmp_path / "broken.zarr" / "opd" / "c" / "9").mkdir(parents=True, exist_ok=True)
    again = run("broken.zarr", 0.0)
    assert again.wait(timeout=120) == 0, again.communicate()
    assert {path: path.stat().st_mtime_ns for path in before} == before
    first, second = (xarray.open_zarr(tmp_path / name, chunks=None).load() for name in ("whole.zarr", "broken.zarr"))
    assert first.identical(second) and np.isfinite(first.strehl).all()


def test_a_finished_store_is_opened_and_another_series_refused(tmp_path: Path):
    pytest.importorskip("zarr")
    series, pupil = opened(Fourier.random(5), TIME[:2]), Disc(0.02, [0, 0, Z0])
    first = optical_series(series, pupil, pixel_count=8, out=tmp_path / "s.zarr", method="linear")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    again = optical_series(series, pupil, pixel_count=8, out=tmp_path / "s.zarr", method="linear")
    assert again.identical(first)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before
    again.to_netcdf(tmp_path / "s.nc")  # which has no attributes that are true or false
    with pytest.raises(ValueError, match="it contains another series, whose remove was"):
        optical_series(series, pupil, pixel_count=8, out=tmp_path / "s.zarr", remove=("piston",), method="linear")
    other = opened(Fourier.random(6), TIME[:2])  # of the same shape, times and surroundings
    with pytest.raises(ValueError, match="another series, whose first snapshot has other densities"):
        optical_series(other, pupil, pixel_count=8, out=tmp_path / "s.zarr", method="linear")
    # Two runs from one initial flow.
    where = {"geometry": "volume", "ambient_density": series.ambient_density} | {
        name: getattr(series.mesh, name) for name in ("origin", "spacing")
    }
    alike = flow.open_series([series.density(0), other.density(1)], time=TIME[:2], **where)
    with pytest.raises(ValueError, match="another series, whose last snapshot has other densities"):
        optical_series(alike, pupil, pixel_count=8, out=tmp_path / "s.zarr", method="linear")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="something else is there"):
        optical_series(series, pupil, pixel_count=8, out=tmp_path / "full")


def test_what_cannot_be_asked_for_is_refused():
    series, pupil = opened(Fourier.random(6), TIME[:1]), Disc(0.02, [0, 0, Z0])
    for options, words in (
        ({"method": "fast"}, "method"),
        ({"pixel_count": 1}, "pixel_count"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"wavelength": 905.0}, "wavelength"),
        ({"remove": "coma"}, "coma"),
        ({"method": "linear", "interpolation": "monotone"}, "linear"),
        ({"direction": (0, 0, 0)}, "direction"),
    ):
        with pytest.raises(ValueError, match=words):
            optical_series(series, pupil, **options)
    for method, words in (("linear", "no ray of the pupil goes through"), ("auto", "meets the field, whose box is")):
        with pytest.raises(ValueError, match=words):
            optical_series(series, Disc(0.02, [3.0, 0.0, Z0]), method=method)
    with pytest.raises(TypeError, match="open_series"):
        optical_series([1], pupil)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="pupil"):
        optical_series(series, 3)
    broken = flow.open_series(
        [np.full(SHAPE, np.nan)],
        time=[0.0],
        geometry="volume",
        origin=ORIGIN,
        spacing=[SPACING] * 3,
        ambient_density=0.5,
    )
    with pytest.raises(ValueError, match=r"snapshot 0.*not finite"):
        optical_series(broken, pupil)


@pytest.mark.parametrize(("beside", "method"), [(False, "linear"), (True, "auto"), (True, "linear")])
def test_what_no_ray_sees_is_said(beside: bool, method: str):
    """A pupil wider than the grid, or a grid that ends in disturbed air: said, and the share that counts is given.

    Straight lines that leave the grid by a side are in no number. By default such a look is traced, and all counts.
    """
    pupil = Disc(0.06 if beside else 0.02, [0, 0, Z0])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", TruncationWarning)
        found = optical_series(opened(Fourier.random(7), TIME[:2]), pupil, pixel_count=16, method=method)
    assert "where rays pass through air" in found.attrs["ends"]
    lost = 1.0 - (found.weight.values * found.valid.values).sum(axis=(1, 2))
    np.testing.assert_allclose(1.0 - found.known, lost, atol=1e-12)
    sideways = beside and method == "linear"
    assert any("leave the grid sideways" in str(one.message) for one in told) == sideways == (lost > 0.05).all()
    assert found.traced.all() == (beside and method == "auto")


@pytest.mark.parametrize("degrees", [44.0, 60.0])
def test_looks_through_the_broad_faces_of_a_slab_are_computed_at_every_angle(degrees: float):
    """Set-up: a layer of waves, at rest at all its faces, that every ray crosses from face z = 0 to face z = 40 mm.

    Expected: the Strehl ratio of `estimate_strehl`, within both errors. Beyond 45 degrees the axis nearest to the rays
    is not z, through whose faces they go; such looks were refused.
    """
    x, z = np.linspace(-0.1, 0.1, 41), np.linspace(0.0, 0.04, 41)
    at = np.meshgrid(x, x, z, indexing="ij")
    share = np.clip(
        [(0.1 - abs(at[0])) / 0.02, (0.1 - abs(at[1])) / 0.02, np.minimum(at[2], 0.04 - at[2]) / 0.01], 0, 1
    )
    rest = np.prod(share**3 * (10.0 - 15.0 * share + 6.0 * share**2), axis=0)
    waves = 0.05 * np.sin(90.0 * at[0] + 30.0 * at[1]) * np.cos(200.0 * at[2]) * rest
    options = {"origin": [-0.1, -0.1, 0.0], "spacing": [5e-3, 5e-3, 1e-3], "ambient_density": 1.2}
    series = flow.open_series([1.2 + waves], time=[0.0], geometry="volume", **options)
    tangent = np.tan(np.radians(degrees))
    pupil = Disc(3e-3, (-0.025 * tangent, 0.0, -0.005), np.array([tangent, 0.0, 1.0]))
    light = {"wavelength": WAVELENGTH, "remove": ("piston",), "backend": "opencl"}
    found = optical_series(series, pupil, pixel_count=24, constant=CONSTANT, **light).isel(time=0)
    field = series[0].index_field(WAVELENGTH, constant=CONSTANT)
    true = estimate_strehl(field, pupil, ray_count=4096, **light)
    assert float(found.known) == pytest.approx(1.0) and true.value < 0.9999
    assert abs(float(found.strehl) - true.value) <= float(found.strehl_error) + true.quantities["value"].error
