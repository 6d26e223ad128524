"""Wavefronts for poppy, whose OPD has the opposite sign (since 1.0: forward transforms of exp(+2 pi i x u))."""

import numpy as np

from ..data import WavefrontMap
from .packages import package


def to_poppy(wavefront: WavefrontMap):
    """A poppy.ArrayOpticalElement: `transmission` the amplitude, `opd` [m] in poppy's sign, `pixelscale` [m / pixel].

    Its `pupil_diam` is the side of the map.

    Raises:
        ModuleNotFoundError: poppy is not there.
    """
    poppy, units = package("poppy"), package("astropy.units")
    element = poppy.ArrayOpticalElement(
        name="aerokernels wavefront",
        transmission=np.array(wavefront.weight),
        opd=poppy_opd(wavefront),
        pixelscale=wavefront.pixel * units.m / units.pixel,
    )
    # What an OpticalSystem takes as its entrance pupil where none is given, as of a file's element.
    element.pupil_diam = len(wavefront.opd) * wavefront.pixel * units.m
    return element


def poppy_opd(wavefront: WavefrontMap) -> np.ndarray:
    """OPD in poppy's sign [m], 0 outside the pupil, shape (n, n)."""
    return np.where(wavefront.lit, -wavefront.opd, 0.0)
