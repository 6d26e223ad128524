"""The laser echo of a target behind a flow: radiometry, waveform, detector, ranging."""

from .detector import detect
from .radiometry import plane_target_echo, tilted_pulse_tau
from .range_error import RangeStatistics, cramer_rao_range, range_statistics
from .ranging import RANGING_METHODS, estimate_range
from .result import EchoResult
from .simulate import echo
from .waveform import fwhm_from_pulse_tau, gaussian_pulse, pulse_energy, pulse_tau_from_fwhm

__all__ = [
    "RANGING_METHODS",
    "EchoResult",
    "RangeStatistics",
    "cramer_rao_range",
    "detect",
    "echo",
    "estimate_range",
    "fwhm_from_pulse_tau",
    "gaussian_pulse",
    "plane_target_echo",
    "pulse_energy",
    "pulse_tau_from_fwhm",
    "range_statistics",
    "tilted_pulse_tau",
]
