"""Sums of a picture and point spread functions over its pixels, by their formulas."""

import numpy as np
import pytest

from aerokernels import (
    Camera,
    Disc,
)
from aerokernels.imaging.render import render
from aerokernels.imaging.spreads import SpreadGrid, pixel_spreads


def test_a_picture_is_the_sum_that_its_formula_says():
    """Every pixel by itself, of a scene known between its pixels: cos(2 pi (p x + q y)), whose spline is some 2e-4 off.

    A kernel's element at (i, j) from its middle multiplies it by that wave, so the sum over nodes of
    h(p) K(p + shift(p) - shift(node)) has a closed form. Shifts differ by up to 3 pixels; 1e-3 of the amplitude.
    """
    draw, size = np.random.default_rng(4), 5
    rows, columns = np.array([0, 7, 18, 29]), np.array([0, 15, 40])
    kernel = draw.random((4, 3, size, size))
    kernel /= kernel.sum(axis=(2, 3), keepdims=True)
    y, x = np.mgrid[:30, :41].astype(float)
    shift = np.stack([2.0 + 1.5 * np.sin(x / 9.0), -1.0 + 1.5 * np.cos(y / 7.0)], axis=-1)
    offset = np.rint(shift[np.ix_(rows, columns)]).astype(int)[..., ::-1]
    wide, edge = np.mgrid[:70, :81], 20
    wave = 2.0 * np.pi * np.array([0.06, 0.08])  # along y and x
    scene = np.cos(wave[0] * (wide[0] - edge) + wave[1] * (wide[1] - edge))
    grid = SpreadGrid(rows, columns, kernel, offset, np.ones((4, 3)))
    step = np.arange(size) - size // 2
    expected = np.zeros(y.shape)
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            moved = shift - shift[row, column]
            place = wave[0] * (y + moved[..., 1] + offset[i, j, 0]) + wave[1] * (x + moved[..., 0] + offset[i, j, 1])
            spread = np.sum(kernel[i, j] * np.exp(1j * (wave[0] * step[:, None] + wave[1] * step)))
            weight = np.outer(np.interp(y[:, 0], rows, np.eye(4)[i]), np.interp(x[0], columns, np.eye(3)[j]))
            expected += weight * (spread * np.exp(1j * place)).real
    assert np.abs(render(scene, grid, shift, np.full(y.shape, 0.5)) - 0.5 * expected).max() < 1e-3


def test_spreads_are_integrals_over_square_pixels():
    """A rough wave of 7 x 7 pixels of the pupil, off the axis: its intensity at 96 places to a pixel and axis.

    Their sum over the triangle that two square pixels share is off by 96^-2 about: 1e-4 of the greatest.
    """
    draw, size, parts = np.random.default_rng(5), 5, 96
    camera = Camera(Disc(2e-3), 0.1, 1.2e-5, 32)
    wave = draw.normal(size=(2, 7, 7)) + 1j * draw.normal(size=(2, 7, 7))
    step, fraction, tangent = 4e-3 / 7, np.array([[0.3, -0.2], [0.0, 0.4]]), np.array([[0.02, -0.01], [0.0, 0.0]])
    kernel, kept = pixel_spreads(wave, step, fraction, tangent, camera, 532e-9, size)
    place = (np.arange(parts * (size + 2)) + 0.5) / parts - 0.5 * (size + 1) - 0.5
    shared = np.clip(1.0 - np.abs(np.arange(size)[:, None] - size // 2 - place), 0.0, None)
    x = step * (np.arange(7) - 3.0)
    for number in range(2):
        # Direction cosines of places along x and y, to first order about the node, in waves to a metre.
        square = 1.0 + float(np.sum(tangent[number] ** 2))
        scale = camera.pixel_tangent * (1.0 - tangent[number] ** 2 / square) / np.sqrt(square) / 532e-9
        along = [np.exp(-2j * np.pi * s * np.outer(place - f, x)) for s, f in zip(scale, fraction[number], strict=True)]
        light = np.abs(along[1] @ wave[number] @ along[0].T) ** 2
        expected = shared @ light @ shared.T
        assert kernel[number] == pytest.approx(expected / expected.sum(), abs=1e-4 * kernel.max())
        whole = np.sum(np.abs(wave[number]) ** 2) / np.prod(scale) / step**2
        assert kept[number] == pytest.approx(expected.sum() / parts**2 / whole, rel=1e-4)
