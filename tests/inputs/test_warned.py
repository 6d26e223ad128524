"""Warnings name the line of the caller."""

import warnings

import numpy as np

from aerokernels import Disc, IndexField, RayBundle, flow, optical_series, trace
from aerokernels.inputs.checks import warn_caller


def small_box(interpolation="cubic"):
    axis = np.linspace(-1e-2, 1e-2, 21)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    contrast = 1e-2 * np.exp(-(x**2 + y**2 + z**2) / (2 * (2e-3) ** 2))
    return IndexField.from_samples(
        contrast, origin=(-1e-2,) * 3, spacing=(1e-3,) * 3, geometry="volume", interpolation=interpolation
    )


def files_of_warnings(call):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        call()
    assert told
    return {one.filename for one in told}


def test_rays_above_the_tolerance_are_the_callers():
    """The line that the warning names was one of aerokernels, which wraps what users call."""
    rays = RayBundle.collimated(Disc(4e-3, center=(0, 0, -2e-2)), 32)
    call = lambda: trace(small_box("linear"), rays, tolerance=1e-12)  # noqa: E731
    assert files_of_warnings(call) == {__file__}


def test_the_end_of_a_series_is_the_callers():
    axis = np.linspace(-0.1, 0.1, 9)
    density = 1.2 + 0.1 * np.ones((9, 9, 9)) * axis
    series = flow.open_series(
        [density, density],
        time=[0.0, 1e-3],
        geometry="volume",
        origin=[-0.1] * 3,
        spacing=[axis[1] - axis[0]] * 3,
        ambient_density=1.2,
    )
    call = lambda: optical_series(series, Disc(0.12), direction=(0, 0, 1), pixel_count=8)  # noqa: E731
    assert files_of_warnings(call) == {__file__}


def test_a_line_outside_the_package_is_the_callers_own():
    assert files_of_warnings(lambda: warn_caller("told")) == {__file__}
