"""Maps over look angles: a ball of air about the pupil looks the same everywhere; where things are on the map."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, flow, look_map

WAVELENGTH = 905e-9
WIDTH, HEIGHT = 0.02, 2e-6  # of the ball: contrast HEIGHT exp(-r^2 / WIDTH^2)


def ball(center=(0.0, 0.0, 0.0), geometry: str = "volume") -> IndexField:
    spacing = 0.01 if geometry == "volume" else 2.5e-3
    half = 0.08
    axes = [np.arange(-half, half + 1e-9, spacing) for _ in range(3)]
    if geometry == "axisymmetric":
        r, z = np.meshgrid(np.arange(0.0, half + 1e-9, spacing), axes[2], indexing="ij")
        contrast = HEIGHT * np.exp(-(r**2 + (z - center[2]) ** 2) / WIDTH**2)
        origin = [0.0, -half]
    else:
        places = np.meshgrid(*axes, indexing="ij")
        contrast = HEIGHT * np.exp(-sum((p - c) ** 2 for p, c in zip(places, center, strict=True)) / WIDTH**2)
        origin = [-half] * 3
    return IndexField.from_samples(
        contrast, origin=origin, spacing=[spacing] * len(origin), geometry=geometry, wavelength=WAVELENGTH
    )


def ball_rms(radius: float) -> float:
    """OPD(rho) = HEIGHT WIDTH sqrt(pi) / 2 exp(-rho^2 / WIDTH^2), from the middle outward; its rms over a disc."""
    share = (np.arange(20000) + 0.5) / 20000  # of the area
    opd = HEIGHT * WIDTH * np.sqrt(np.pi) / 2.0 * np.exp(-(radius**2) * share / WIDTH**2)
    return float(opd.std())


@pytest.mark.parametrize("geometry", ["axisymmetric", "volume"])
def test_a_ball_about_the_pupil_looks_the_same_everywhere(geometry: str):
    """Error: the spline's on 8 or 2 nodes a width: 1 % and 1e-4."""
    angles = np.radians([-70.0, 0.0, 30.0])
    found = look_map(ball(geometry=geometry), angles, angles[1:], Disc(0.015), ray_count=1024, tolerance=1e-3)
    assert found.strehl.dims == ("azimuth", "elevation") and found.strehl.shape == (3, 2)
    tolerance = 1e-3 if geometry == "axisymmetric" else 0.05
    np.testing.assert_allclose(found.opd_rms, ball_rms(0.015), rtol=tolerance)
    strehl = np.exp(-((2.0 * np.pi * found.opd_rms / WAVELENGTH) ** 2))
    np.testing.assert_allclose(found.strehl, strehl, atol=1e-3)
    assert (found.blocked == 0.0).all() and (found.known == 1.0).all()
    assert float(found.boresight.max()) < 0.05 * float(found.opd_rms.max()) / 0.015


def test_azimuth_turns_toward_x_and_elevation_toward_y():
    """A ball ahead and above: seen above, not below; light is delayed toward it, and the wavefront tilts there."""
    angles = np.radians([-45.0, 0.0, 45.0])
    found = look_map(ball((0.0, 0.03, 0.03)), angles, angles, Disc(0.01), ray_count=256)
    rms, up, aside = found.opd_rms.values, found.boresight_elevation.values, found.boresight_azimuth.values
    assert rms[:, 0].max() < 0.2 * rms[:, 2].min()
    assert up[1, 1] > 50.0 * abs(aside[1, 1]) and up[1, 1] > 20.0 * abs(up[1, 2])
    assert aside[0, 2] > 1e-6 and aside[2, 2] < -1e-6
    np.testing.assert_allclose(rms[0], rms[2], rtol=0.1)
    np.testing.assert_allclose(found.boresight, np.hypot(up, aside), rtol=1e-9)
    other = look_map(ball((0.03, 0.0, 0.03)), [0.0], [0.0], Disc(0.01), ray_count=256)
    assert float(other.boresight_azimuth[0, 0]) == pytest.approx(up[1, 1], rel=0.05)


def test_directions_at_one_angle_from_the_axis_are_traced_once(monkeypatch: pytest.MonkeyPatch):
    """Symmetric against the same with the symmetry kept out of sight: numbers, and which way the tilt points."""
    import aerokernels.series.look as look

    field, pupil = ball((0.0, 0.0, 0.02), "axisymmetric"), Disc(0.01)
    angles = np.radians([-30.0, 0.0, 20.0])
    counted = []
    original = look._look
    monkeypatch.setattr(look, "_look", lambda *given: counted.append(0) or original(*given))
    short = look_map(field, angles, angles, pupil, ray_count=1024)
    assert len(counted) == 6  # 0, 20, 30, and the three of their pairs
    monkeypatch.setattr(look, "asymmetry", lambda *given: "kept out of sight")
    long = look_map(field, angles, angles, pupil, ray_count=1024)
    assert len(counted) == 6 + 9
    for name, scale in (("opd_rms", 1e-9), ("boresight_azimuth", 2e-8), ("boresight_elevation", 2e-8)):
        np.testing.assert_allclose(short[name], long[name], atol=scale)
    assert float(np.abs(long.boresight_azimuth).max()) > 1e-6


def test_the_body_shades():
    """Beside the wind-tunnel model: toward it all is in shadow, away from it nothing, along its side a part."""
    pupil = Disc(6e-3, [0.0, 0.05, -0.05])
    found = look_map(flow.shipped("mach3"), [0.0], np.radians([-90.0, -40.0, 60.0]), pupil, ray_count=256)
    blocked, strehl = found.blocked.values[0], found.strehl.values[0]
    assert blocked[0] == 1.0 and blocked[2] == 0.0 and 0.0 <= blocked[1] <= 1.0
    assert np.isnan(strehl[0]) and np.isnan(found.boresight.values[0, 0]) and 0.0 < strehl[2] <= 1.0
    assert found.known.values[0].tolist() == [0.0, 1.0, 1.0]  # where there is no number, nothing is known


def test_errors_of_looks_cover_the_truth():
    """A turbulent volume of 25 nodes a side against the same modes on 49, with more rays; those of 9 directions."""
    from tests.series.fourier import CONSTANT, Fourier

    volume = Fourier.random(9, wavenumber=80.0, amplitude=0.03)
    volume.mean = 0.0

    def seen(nodes: int, ray_count: int):
        field = IndexField.from_samples(
            CONSTANT * volume.on_grid([-0.1] * 3, 0.2 / (nodes - 1), (nodes,) * 3, 0.0),
            origin=[-0.1] * 3, spacing=[0.2 / (nodes - 1)] * 3, geometry="volume", wavelength=WAVELENGTH)  # fmt: skip
        angles = np.radians([-25.0, 5.0, 20.0])
        return look_map(field, angles, angles, Disc(0.03, [0.0, 0.01, -0.02]), ray_count=ray_count)

    found, true = seen(25, 2048), seen(49, 8192)
    for name in ("strehl", "opd_rms", "boresight", "boresight_azimuth", "boresight_elevation"):
        told, off = found[f"{name}_error"].values, np.abs(found[name] - true[name]).values
        assert np.count_nonzero(off > told) <= 1 and np.median(told / off) < 20.0, name


def test_a_series_has_time():
    arrays = [np.full((9, 9, 9), 0.5 + 0.05 * k) for k in range(2)]
    arrays[1][4, 4, 4] += 0.3
    options = {"geometry": "volume", "origin": [-0.04] * 3, "spacing": [0.01] * 3, "ambient_density": 0.5}
    steps = []
    found = look_map(
        flow.open_series(arrays, time=[0.0, 1.0], **options),
        [0.0, 0.3],
        [0.0],
        Disc(0.01, [0.0, 0.0, -0.03]),
        ray_count=64,
        progress=lambda text, share: steps.append(share),
    )
    assert found.strehl.dims == ("time", "azimuth", "elevation")
    assert float(found.opd_rms[0, 0, 0]) < float(found.opd_rms[1, 0, 0]) and steps[-1] == 1.0


def test_what_cannot_be_looked_at_is_refused():
    field, pupil = ball(), Disc(0.01)
    for arguments, words in (
        ((field, [90.0], [0.0], pupil), "radians"),
        ((field, [-12, -6, 0, 6], [0.0], pupil), "azimuth must be between -3.142 and 3.142, in radians, got 12"),
        ((field, [0.0, 3.2], [0.0], pupil), "np.radians"),
        ((field, [0.0], [2.0], pupil), "elevation must be between -1.571 and 1.571"),
        ((field, [np.nan], [0.0], pupil), "azimuth"),
        ((field, [0.0], [], pupil), "elevation"),
        ((field, [0.0, 0.1], [0.0], Disc(0.01, [0.0, 0.0, 5.0])), "units"),
        ((field, [0.0, 0.1], [0.0], Disc(6.0)), "the pupil's reach of 6 m is .* times the field's"),
    ):
        with pytest.raises(ValueError, match=words):
            look_map(*arguments, ray_count=64)
    with pytest.warns(
        UserWarning, match=r"azimuth \[-3.0, 0.0, 3.0\] is taken in radians; np.radians converts degrees"
    ):
        look_map(field, [-3, 0, 3], [0.0], pupil, ray_count=64)
    with pytest.raises(ValueError, match="ray_count"):
        look_map(field, [0.0], [0.0], pupil, ray_count=0)
    with pytest.raises(TypeError, match="field"):
        look_map(3, [0.0], [0.0], pupil)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="pupil"):
        look_map(field, [0.0], [0.0], 3)
