"""Wavefronts for prysm, whose sign and order of axes are ours; its lengths are nm, um and mm."""

import numpy as np

from ..data import WavefrontMap
from .packages import package


def to_prysm(wavefront: WavefrontMap):
    """A prysm.propagation.Wavefront: amplitude, OPD as its phase [nm], wavelength [um], dx [mm].

    Raises:
        ModuleNotFoundError: prysm is not there.
    """
    prysm = package("prysm.propagation")
    phase = np.where(wavefront.lit, wavefront.opd, 0.0) * 1e9
    return prysm.Wavefront.from_amp_and_phase(
        np.array(wavefront.weight), phase, wavefront.wavelength * 1e6, wavefront.pixel * 1e3
    )
