"""Simulate the laser echo of a target behind a flow: radiometry, waveform, detector and ranging."""

from aerokernels.lidar.chain import DetectorChain, Digitiser, NoiseSources, excess_noise_factor
from aerokernels.lidar.detector import detect
from aerokernels.lidar.parts import RANGING_METHODS, Detector, Laser, Receiver, Reflector, Target
from aerokernels.lidar.paths import plane_target_echo, tilted_pulse_tau
from aerokernels.lidar.pulses import (
    GaussianPulse,
    HeliosPulse,
    SampledPulse,
    fwhm_from_pulse_tau,
    pulse_tau_from_fwhm,
)
from aerokernels.lidar.range_error import RangeStatistics, cramer_rao_range, range_statistics
from aerokernels.lidar.ranging import CoarseSamplingWarning, SaturatedRecordWarning, estimate_range
from aerokernels.lidar.result import EchoResult
from aerokernels.lidar.simulate import echo, simulate_echo

__all__ = [
    "RANGING_METHODS",
    "CoarseSamplingWarning",
    "Detector",
    "DetectorChain",
    "Digitiser",
    "EchoResult",
    "GaussianPulse",
    "HeliosPulse",
    "Laser",
    "NoiseSources",
    "RangeStatistics",
    "Receiver",
    "Reflector",
    "SampledPulse",
    "SaturatedRecordWarning",
    "Target",
    "cramer_rao_range",
    "detect",
    "echo",
    "estimate_range",
    "excess_noise_factor",
    "fwhm_from_pulse_tau",
    "plane_target_echo",
    "pulse_tau_from_fwhm",
    "range_statistics",
    "simulate_echo",
    "tilted_pulse_tau",
]
