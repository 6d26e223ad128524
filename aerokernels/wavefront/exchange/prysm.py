"""Export to prysm, which has the same sign and order of axes as aerokernels; its lengths are nm, um and mm."""

import numpy as np

from ..data import WavefrontMap
from .packages import package


def to_prysm(wavefront: WavefrontMap):
    """Return a prysm.propagation.Wavefront: amplitude, OPD as its phase [nm], wavelength [um], dx [mm].

    Raises:
        ModuleNotFoundError: prysm is not installed.
    """
    prysm = package("prysm.propagation")
    phase = np.where(wavefront.lit, wavefront.opd, 0.0) * 1e9
    return prysm.Wavefront.from_amp_and_phase(
        np.array(wavefront.weight), phase, wavefront.wavelength * 1e6, wavefront.pixel * 1e3
    )
