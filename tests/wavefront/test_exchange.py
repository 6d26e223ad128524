"""Wavefronts in other packages: their own point spread functions, readers and fits say what ours say."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Mask, Polygon, Rectangle, Wavefront
from aerokernels.wavefronts.pixels import pupil_grid
from aerokernels.zernike import zernike_modes
from tests.wavefront.zemax_files import read_zemax

WAVELENGTH = 905e-9
RADIUS = 3e-3
COUNT = 48
RESOLUTION = WAVELENGTH / (2.0 * RADIUS)
SIDE = 41
STEP = 0.25 * RESOLUTION
ANGLE = STEP * (np.arange(SIDE) - SIDE // 2)


def made(coefficients, pupil=None) -> Wavefront:
    """A wavefront of Zernike modes [m], or of a tilt, two slopes [rad], over an annulus or another pupil."""
    coordinate, pixel, weight, intensity = pupil_grid(pupil or Annulus(RADIUS, 0.2 * RADIUS), COUNT)
    x, y = np.meshgrid(coordinate, coordinate)
    if len(coefficients) == 2:
        opd = coefficients[0] * x + coefficients[1] * y
    else:
        opd = np.tensordot(coefficients, zernike_modes(len(coefficients), x / RADIUS, y / RADIUS), 1)
    return Wavefront(
        opd, weight, pixel, WAVELENGTH, intensity=intensity, radius=RADIUS, budget=lambda: {"total": 1e-10}
    )


SLOPES = (8 * STEP, 4 * STEP)  # eight steps to +x, four to +y
LOPSIDED = Mask(np.array([[1.0, 1.0, 0.2], [1.0, 0.5, 0.0], [1.0, 0.0, 0.0]]), 2e-3)


@pytest.fixture(params=["tilt", "modes", "lopsided"])
def wave(request) -> Wavefront:
    """A tilt; fifteen modes; a pupil and a wavefront without any symmetry."""
    if request.param == "tilt":
        return made(np.array(SLOPES))
    values = 6e-8 * np.random.default_rng(4).uniform(-1.0, 1.0, 15)
    return made(values, LOPSIDED if request.param == "lopsided" else None)


def poppy_psf(element) -> np.ndarray:
    """A point spread function by poppy's own propagation through a pupil, over the angles ANGLE."""
    import poppy

    system = poppy.OpticalSystem(npix=COUNT, oversample=1)  # the element says how wide it is
    system.add_pupil(element)
    system.add_detector(pixelscale=np.rad2deg(STEP) * 3600.0, fov_pixels=SIDE, oversample=1)
    return np.array(system.calc_psf(WAVELENGTH, normalize="first")[0].data)


def assert_same_psf(theirs: np.ndarray, wave: Wavefront) -> None:
    """The same picture to 1e-8 of its peak, whatever it is divided by; a tilt's peak lies at +x, +y, exactly."""
    ours = wave.psf(ANGLE).intensity
    assert np.abs(theirs / theirs.max() - ours / ours.max()).max() < 1e-8
    if np.ptp(wave.remove("tilt").samples[0]) < 1e-15:
        assert np.unravel_index(np.argmax(theirs), theirs.shape) == (SIDE // 2 + 4, SIDE // 2 + 8)


def test_prysm_makes_the_same_picture(wave: Wavefront):
    pytest.importorskip("prysm")
    theirs = wave.to_prysm().focus_fixed_sampling(100.0, 100.0 * STEP * 1e3, SIDE)
    assert_same_psf(np.abs(theirs.data) ** 2, wave)


def test_prysm_makes_the_same_mtf(wave: Wavefront):
    """Its FFT of the picture over a whole period of angles, where nothing is cut off: exact for the pixels."""
    pytest.importorskip("prysm")
    from prysm.otf import mtf_from_psf

    focused = wave.to_prysm().focus(100.0, Q=2)
    theirs = mtf_from_psf(np.abs(focused.data) ** 2, focused.dx).data
    middle = len(theirs) // 2
    rows = slice(middle - COUNT + 1, middle + COUNT)
    ours = wave.mtf().value * wave.power / np.sum(wave.weight**2)
    ours[COUNT - 1, COUNT - 1] = 1.0
    assert np.abs(theirs[rows, rows] - ours).max() < 1e-8


def test_hcipy_makes_the_same_picture(wave: Wavefront):
    hcipy = pytest.importorskip("hcipy")
    given = wave.to_hcipy()
    focal = hcipy.make_uniform_grid([SIDE, SIDE], SIDE * STEP)
    picture = hcipy.FraunhoferPropagator(given.electric_field.grid, focal)(given).intensity
    assert_same_psf(np.asarray(picture.shaped), wave)


def test_hcipys_own_file_holds_the_field(wave: Wavefront, tmp_path):
    """Its FITS (ASDF in FITS) takes real fields only, its ASDF complex ones too."""
    hcipy = pytest.importorskip("hcipy")
    given = wave.to_hcipy()
    for name, field in (("field.fits", given.phase), ("field.asdf", given.electric_field)):
        hcipy.write_field(field, str(tmp_path / name))
        again = hcipy.read_field(str(tmp_path / name))
        assert np.array_equal(np.asarray(again), np.asarray(field)) and np.allclose(again.grid.x, field.grid.x)


def test_poppy_makes_the_same_picture(wave: Wavefront):
    pytest.importorskip("poppy")
    assert_same_psf(poppy_psf(wave.to_poppy()), wave)


def test_poppy_reads_the_fits_files(wave: Wavefront, tmp_path):
    """Its own reader takes PIXELSCL and BUNIT from the headers, and propagates to the same picture."""
    poppy = pytest.importorskip("poppy")
    wave.to_fits(tmp_path / "opd.fits")
    element = poppy.FITSOpticalElement(
        transmission=str(tmp_path / "opd_amplitude.fits"),
        opd=str(tmp_path / "opd.fits"),
        planetype=poppy.poppy_core.PlaneType.pupil,
    )
    assert element.pixelscale.to_value("m/pixel") == pytest.approx(wave.pixel)
    assert element.opd_header["BUNIT"] == "meter"
    assert_same_psf(poppy_psf(element), wave)


def test_a_fits_file_is_read_as_it_was_written(tmp_path):
    """Coma along x and y of different size, which no mirrored, turned or negated map has; and the errors of pixels."""
    pytest.importorskip("astropy")
    given = made(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3e-8, -7e-8]))
    given.to_fits(tmp_path / "opd.fits")
    again = Wavefront.read(tmp_path / "opd.fits")
    assert np.array_equal(again.opd, given.opd, equal_nan=True) and np.array_equal(again.weight, given.weight)
    assert np.array_equal(again.intensity, given.intensity) and again.wavelength == WAVELENGTH
    assert again.zernike(8) == pytest.approx(given.zernike(8), abs=1e-16)
    assert again.pixel_errors == pytest.approx(given.pixel_errors, nan_ok=True)


def test_a_fits_file_of_another_program_states_sign_unit_and_pixel(tmp_path):
    """Light delayed at +x, in micron: negative in poppy's files, whose columns are x."""
    fits = pytest.importorskip("astropy.io.fits")
    ramp = np.tile(np.linspace(-0.05, 0.05, 8), (8, 1))
    path = tmp_path / "poppy.fits"

    def write(**header):
        fits.writeto(path, -ramp, fits.Header(header), overwrite=True)

    write(PIXELSCL=1e-3, BUNIT="micron")
    with pytest.raises(ValueError, match="WAVELEN: give the wavelength"):
        Wavefront.read(path)
    found = Wavefront.read(path, wavelength=1e-6)
    assert found.pixel == 1e-3 and found.tilt == pytest.approx([1e-7 / 7e-3, 0.0], abs=1e-15)
    write(PIXELSCL=1e-3, BUNIT="micron", WAVELEN=1e-6, OPDSIGN="POSITIVE")
    assert Wavefront.read(path).tilt == pytest.approx([-1e-7 / 7e-3, 0.0], abs=1e-15)
    for header in ({"BUNIT": "micron"}, {"PIXELSCL": 1e-3}, {"PIXELSCL": 1e-3, "BUNIT": "waves"}):
        write(**header)
        with pytest.raises(ValueError, match=r"poppy\.fits: the header must state"):
            Wavefront.read(path, wavelength=1e-6)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(ValueError, match=r"poppy\.fits: no FITS file"):
        Wavefront.read(path, wavelength=1e-6)


def test_coefficients_are_those_of_the_others():
    """The same OPD, fitted by their own polynomials and plain least squares: to 1e-10 of the greatest coefficient."""
    values = 6e-8 * np.random.default_rng(11).uniform(-1.0, 1.0, 21)
    wave = made(values)
    opd, weight = wave.samples
    x, y = wave.points.T / RADIUS
    bases = {}
    if prysm := pytest.importorskip("prysm.polynomials"):
        rho, theta = np.hypot(x, y), np.arctan2(y, x)
        orders = [prysm.noll_to_nm(index) for index in range(1, 22)]
        bases["prysm"] = [prysm.zernike_nm(n, m, rho, theta, norm=True) for n, m in orders]
    if poppy := pytest.importorskip("poppy"):
        bases["poppy"] = [poppy.zernike.zernike1(index, rho=rho, theta=theta, outside=0.0) for index in range(1, 22)]
    if hcipy := pytest.importorskip("hcipy"):
        grid = hcipy.CartesianGrid(hcipy.UnstructuredCoords([x, y]))
        bases["hcipy"] = [
            hcipy.zernike(*hcipy.noll_to_zernike(j), 2.0, grid, radial_cutoff=False) for j in range(1, 22)
        ]
    ours = wave.zernike(21)
    root = np.sqrt(weight)
    for name, basis in bases.items():
        # poppy and hcipy cut their polynomials off at the rim, where a pixel's centre may lie just outside.
        inside = x * x + y * y < 1.0
        theirs = np.linalg.lstsq((np.array(basis).T * root[:, None])[inside], (opd * root)[inside], rcond=None)[0]
        assert np.abs(theirs - ours).max() < 1e-10 * np.abs(values).max(), name


def test_zemax_grid_runs_from_the_upper_left(tmp_path):
    """Header nx ny dx dy [mm] unit 0; first the row of greatest y, from -x; its sign is the negative of ours."""
    wave = made(np.array([1e-4, 3e-5]))
    wave.to_zemax(tmp_path / "phase.dat")
    head, *rest = (tmp_path / "phase.dat").read_text().splitlines()
    assert [float(word) for word in head.split()] == [COUNT, COUNT, wave.pixel * 1e3, wave.pixel * 1e3, 0, 0, 0]
    assert len(rest) == COUNT**2
    table = np.array([[float(word) for word in line.split()] for line in rest]).reshape(COUNT, COUNT, 5)
    row, column = 3, COUNT // 2 + 2
    y, x = wave.coordinate[COUNT - 1 - row], wave.coordinate[column]
    assert table[row, column, 4] == 0.0
    assert table[row, column, 0] == pytest.approx(-2.0 * np.pi / WAVELENGTH * (1e-4 * x + 3e-5 * y), rel=1e-12)
    assert table[0, 0, 4] == 1.0
    wave.to_zemax(tmp_path / "sag.dat", "sag")
    height, lit, pixel = read_zemax(tmp_path / "sag.dat")
    assert (lit == wave.lit).all() and pixel == pytest.approx(wave.pixel)
    assert height[lit] * 1e-3 == pytest.approx(-wave.opd[lit], abs=1e-20)
    with pytest.raises(ValueError, match="kind 'opd' is not known: choose one of phase, sag"):
        wave.to_zemax(tmp_path / "x.dat", "opd")
    (tmp_path / "torn.dat").write_text("2 2 1 1 0\n1 0 0 0\n")
    with pytest.raises(ValueError, match="is no Zemax grid file"):
        read_zemax(tmp_path / "torn.dat")


def test_netcdf_there_and_back(wave: Wavefront, tmp_path):
    """Units, sign convention and all numbers survive a file; what it makes of the light is the same."""
    import xarray

    data = wave.remove("piston").to_xarray()
    data.to_netcdf(tmp_path / "wavefront.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "wavefront.nc", engine="h5netcdf") as again:
        assert again.attrs["Conventions"] == "CF-1.8"
        assert (
            again["opd"].attrs["sign_convention"]
            == again.attrs["sign_convention"]
            == "OPD is positive where light is delayed"
        )
        assert again["opd"].attrs["units"] == again["x"].attrs["units"] == "m" and again["opd"].dims == ("y", "x")
        back = Wavefront.from_xarray(again.load())
    assert back.strehl() == wave.strehl() or abs(back.strehl() - wave.strehl()) < 1e-12
    assert back.opd_error == 1e-10 and back.removed == ("piston",) and back.radius == wave.radius
    assert np.array_equal(back.intensity, wave.intensity)
    with pytest.raises(ValueError, match="sign convention is 'positive where light leads'"):
        Wavefront.from_xarray(data.assign_attrs(sign_convention="positive where light leads"))
    with pytest.raises(ValueError, match="opd, weight, wavelength, pixel, sign_convention is missing"):
        Wavefront.from_xarray(xarray.Dataset())


def test_a_dataset_that_was_changed_is_refused(wave: Wavefront):
    """A map turned round had tilts of the other sign, one thinned out tilts twice as large, with no word of it."""
    data = wave.to_xarray()
    halves = slice(None, None, -1), slice(None, None, 2), slice(0, len(data.y) // 2)
    for part in halves:
        with pytest.raises(
            ValueError, match="the dataset's y must ascend about the pupil's centre in steps of its pix"
        ):
            Wavefront.from_xarray(data.isel(y=part, x=part))
    with pytest.raises(ValueError, match="the dataset's x must ascend"):
        Wavefront.from_xarray(data.isel(x=slice(None, None, -1)))
    single = data.assign_coords(x=data.x.astype("f4"), y=data.y.astype("f4"))
    assert np.array_equal(Wavefront.from_xarray(single).tilt, wave.tilt)
    assert np.array_equal(Wavefront.from_xarray(data.drop_vars(["x", "y"])).tilt, wave.tilt)
    nanometres = data.assign(opd=(1e9 * data.opd).assign_attrs(units="nm"))
    with pytest.raises(ValueError, match="the dataset's opd is in 'nm': convert it to metres"):
        Wavefront.from_xarray(nanometres)


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize(
    "pupil",
    [
        Disc(0.01, center=(0.1, 0.2, 0.3), normal=(0.1, 0.0, 1.0)),
        Annulus(0.01, 0.004),
        Rectangle(0.01, 0.02),
        Polygon([[-0.01, -0.01], [0.01, -0.01], [0.0, 0.012]]),
        Mask(np.linspace(0.1, 1.0, 20).reshape(4, 5), 1e-3),
        Mask([[1.0]], (1e-3, 2e-3)),
    ],
    ids=lambda pupil: type(pupil).__name__,
)
def test_a_pupil_goes_with_its_wavefront(pupil, engine: str, tmp_path):
    """Its numbers survive a file, and so do the reported errors, which know where its edges cut through pixels."""
    import xarray

    coordinate, pixel, weight, intensity = pupil_grid(pupil, 16)
    opd = 3e-8 * np.cos(200.0 * coordinate) + 1e-8 * np.sin(300.0 * coordinate)[:, None]
    wave = Wavefront(*(opd, weight, pixel, 1e-6), intensity=intensity, pupil=pupil, budget=lambda: {"total": 1e-12})
    wave.to_xarray().to_netcdf(tmp_path / "wavefront.nc", engine=engine)
    with xarray.open_dataset(tmp_path / "wavefront.nc", engine=engine) as again:
        back = Wavefront.from_xarray(again.load())
    assert type(back.pupil) is type(pupil)
    for name, value in vars(pupil).items():
        if name in type(pupil).__dataclass_fields__:
            np.testing.assert_array_equal(getattr(back.pupil, name), value)
    assert {name: one.error for name, one in back.quantities.items()} == {
        name: one.error for name, one in wave.quantities.items()
    }
    assert Wavefront.from_xarray(again.drop_attrs().assign_attrs(
        {name: value for name, value in again.attrs.items() if name != "pupil_normal"}
    )).pupil is None  # fmt: skip


def test_pictures_can_be_drawn(wave: Wavefront):
    from matplotlib.figure import Figure

    axes = Figure(figsize=(3, 3)).subplots(2, 2).ravel()
    drawn = [wave.plot(axes[0]), wave.psf(ANGLE).plot(axes[1]), wave.mtf().plot(axes[2])]
    drawn.append(wave.encircled_energy(ANGLE[21:]).plot(axes[3]))
    assert [one.get_xlabel() for one in drawn] == [
        "x in the pupil [mm]",
        "field angle x [urad]",
        "spatial frequency [cycles / mrad]",
        "angle [urad]",
    ]
    drawn[0].figure.canvas.draw()
