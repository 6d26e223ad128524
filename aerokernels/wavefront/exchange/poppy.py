"""Export to poppy, whose OPD has the opposite sign (since 1.0: forward transforms of exp(+2 pi i x u))."""

import numpy as np

from ..data import WavefrontMap
from .packages import package


def to_poppy(wavefront: WavefrontMap):
    """Return a poppy.ArrayOpticalElement: `transmission` (amplitude), `opd` [m] in poppy's sign, `pixelscale`.

    `pixelscale` is in m / pixel; `pupil_diam` is the side of the map [m].

    Raises:
        ModuleNotFoundError: poppy is not installed.
    """
    poppy, units = package("poppy"), package("astropy.units")
    element = poppy.ArrayOpticalElement(
        name="aerokernels wavefront",
        transmission=np.array(wavefront.weight),
        opd=poppy_opd(wavefront),
        pixelscale=wavefront.pixel * units.m / units.pixel,
    )
    # An OpticalSystem without an entrance pupil takes its diameter from here, as from elements read from files.
    element.pupil_diam = len(wavefront.opd) * wavefront.pixel * units.m
    return element


def poppy_opd(wavefront: WavefrontMap) -> np.ndarray:
    """Return the OPD in poppy's sign [m], 0 outside the pupil, shape (n, n)."""
    return np.where(wavefront.lit, -wavefront.opd, 0.0)
