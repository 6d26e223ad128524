"""Simulate the laser echo of a target behind a flow: radiometry, waveform, detector and ranging."""

from ..callable_module import make_callable
from .chain import DetectorChain
from .detector import detect
from .digitiser import Digitiser
from .noise import NoiseSources, excess_noise_factor
from .pulses import GaussianPulse, HeliosPulse, SampledPulse
from .radiometry import plane_target_echo, tilted_pulse_tau
from .range_error import RangeStatistics, chain_range_statistics, cramer_rao_range, range_statistics
from .range_walk import RangeWalk, range_walk
from .ranging import RANGING_METHODS, estimate_range
from .reflectors import Reflector
from .result import EchoResult
from .sampling_error import CoarseSamplingWarning
from .saturation import SaturatedRecordWarning
from .simulate import echo
from .waveform import fwhm_from_pulse_tau, gaussian_pulse, pulse_energy, pulse_tau_from_fwhm

__all__ = [
    "RANGING_METHODS",
    "CoarseSamplingWarning",
    "DetectorChain",
    "Digitiser",
    "EchoResult",
    "GaussianPulse",
    "HeliosPulse",
    "NoiseSources",
    "RangeStatistics",
    "RangeWalk",
    "Reflector",
    "SampledPulse",
    "SaturatedRecordWarning",
    "chain_range_statistics",
    "cramer_rao_range",
    "detect",
    "echo",
    "estimate_range",
    "excess_noise_factor",
    "fwhm_from_pulse_tau",
    "gaussian_pulse",
    "plane_target_echo",
    "pulse_energy",
    "pulse_tau_from_fwhm",
    "range_statistics",
    "range_walk",
    "tilted_pulse_tau",
]

make_callable(__name__)
