"""Wavefronts for prysm, whose sign and order of axes are ours; its lengths are nm, um and mm."""

import numpy as np

from ..data import WavefrontMap


def to_prysm(wavefront: WavefrontMap):
    """A prysm.propagation.Wavefront: amplitude, OPD as its phase [nm], wavelength [um], dx [mm].

    Raises:
        ModuleNotFoundError: prysm is not there.
    """
    from prysm.propagation import Wavefront

    phase = np.where(wavefront.lit, wavefront.opd, 0.0) * 1e9
    return Wavefront.from_amp_and_phase(
        np.array(wavefront.weight), phase, wavefront.wavelength * 1e6, wavefront.pixel * 1e3
    )
