"""A small run's dataset, made from formulas, so that pictures and files are tested without a flow field."""

import numpy as np
import pytest
import xarray


@pytest.fixture
def dataset() -> xarray.Dataset:
    """What `jobs.run` makes, in small: a Gaussian density blob, a defocused wavefront, a Gaussian pulse."""
    corner_y, corner_z = np.meshgrid(np.linspace(0.0, 0.02, 9), np.linspace(-0.03, 0.01, 13), indexing="ij")
    middle = [0.25 * (a[1:, 1:] + a[1:, :-1] + a[:-1, 1:] + a[:-1, :-1]) for a in (corner_y, corner_z)]
    density = 0.3 + 1.0 * np.exp(-(middle[0] ** 2 + middle[1] ** 2) / 0.005**2)
    axis = np.linspace(-0.004, 0.004, 33)
    x, y = np.meshgrid(axis, axis)
    opd = np.where(x**2 + y**2 <= 0.004**2, 50e-9 * ((x**2 + y**2) / 0.004**2 - 0.5), np.nan)
    planes, start = np.linspace(-0.008, 0.01, 6), np.linspace(-0.004, 0.004, 5)
    deviation = 1e-6 * start[:, None] / 0.004 * np.linspace(0.0, 1.0, 6) ** 2
    position = np.zeros((5, 6, 3))
    position[..., 1], position[..., 2] = start[:, None] + deviation, planes
    angle = np.linspace(-300e-6, 300e-6, 41)
    spread = np.exp(-(angle[:, None] ** 2 + angle**2) / 100e-6**2)
    time = np.linspace(0.0, 40e-9, 401)
    pulse = np.exp(-(((time - 10e-9) / 3e-9) ** 2))

    def unit(dims, values, units):
        return dims, values, {"units": units, "long_name": units}

    with_rms = unit(("pupil_y", "pupil_x"), opd, "m")
    with_rms[2].update(rms_m=float(np.sqrt(np.nanmean(opd**2))), rms_error_m=1e-10)
    return xarray.Dataset(
        {
            "density": unit(("cell_i", "cell_j"), density, "kg/m3"),
            "density_y": unit(("corner_i", "corner_j"), corner_y, "m"),
            "density_z": unit(("corner_i", "corner_j"), corner_z, "m"),
            "body_y": unit("body_vertex", np.array([0.0, 0.008, 0.008, 0.0]), "m"),
            "body_z": unit("body_vertex", np.array([0.0, -0.008, -0.03, -0.03]), "m"),
            "ray_position": unit(("ray", "plane", "axis"), position, "m"),
            "ray_deviation": unit(("ray", "plane"), deviation, "m"),
            "opd": with_rms,
            "opd_error": unit(("pupil_y", "pupil_x"), np.where(np.isfinite(opd), 1e-10, np.nan), "m"),
            "zernike": unit("noll_index", np.where(np.arange(1, 12) == 4, 14.4e-9, 0.0), "m"),
            "zernike_error": unit("noll_index", np.full(11, 1e-10), "m"),
            "opd_without_tilt": with_rms,
            "opd_without_focus": with_rms,
            "point_spread": unit(("angle_y", "angle_x"), 0.9 * spread, "1"),
            "point_spread_perfect": unit(("angle_y", "angle_x"), spread, "1"),
            "echo_power": unit("time", 2e-6 * pulse, "W"),
            "echo_voltage": unit("time", 0.2 * pulse, "V"),
        },
        coords={
            "pupil_x": unit("pupil_x", axis, "m"),
            "pupil_y": unit("pupil_y", axis, "m"),
            "angle_x": unit("angle_x", angle, "rad"),
            "angle_y": unit("angle_y", angle, "rad"),
            "time": unit("time", time, "s"),
            "axis": unit("axis", np.array(["x", "y", "z"]), "1"),
        },
        attrs={
            "geometry": "axisymmetric",
            "pupil_axes": ["x", "y"],
            "strehl": 0.9,
            "threshold_v": 0.05,
            "range_m": 1.4990,
            "true_range_m": 1.5,
            "flow_front_m": 0.004,
        },
    )
