"""The echo of a scene: eq 9-12 of the paper as a sum over the beam in two dimensions.

    P(t) = sum over the rays i of  w_i P0 (rho / pi) cos(phi_i) (pi D^2 / 4) / R_i^2 eta_a^2 eta_s SR_i
                                   * exp(-((t - 2 R_i / c) / tau)^2)

w_i is the share of the beam's power in ray i, R_i its optical path to the tilted target, phi_i its incidence there and
SR_i the Strehl ratio of the return path from where it lands (return factor "strehl", as in the paper). Light takes
as long back as out. R_i^2 is that of an optical path too, as eq 10 has it: 5e-4 of the power at sea level. Where a ray
lands decides its path, incidence and Strehl ratio; which rays the reflector catches is decided without the flow, whose
0.1 mm of deflection matters at the edges only.

The range is calibrated as a rangefinder's is, on a known echo: that of the same scene in vacuum. The reading's error
there is subtracted, for each method. What remains is what air and flow do: the walk of a fixed threshold with the
amplitude above all, and the air's optical path (0.4 mm over 1.5 m at sea level).
"""

import math

import numpy as np

from ..medium import IndexField
from ..prepare import prepare_field
from ..scene import Scene
from .detector import detect, sample_times
from .paths import TransmitPaths, return_paths, target_plane, transmit_paths, vacuum_paths
from .pulse_curve import peak_height
from .radiometry import plane_echo_power
from .ranging import RANGING_METHODS, estimate_range
from .result import EchoResult
from .target_points import target_points
from .waveform import SPEED_OF_LIGHT, sum_of_pulses

# The record reaches this far around the echo [tau]: the pulse is down to 2e-16 of its peak there.
RECORD_MARGIN = 6.0
# The detector's low-pass rings for a few 1 / bandwidth.
FILTER_MARGIN = 3.0
# Power is computed at least this many times a tau, however slow the digitiser: nothing of the pulse is aliased.
LEAST_RATE = 8.0


def echo(
    scene: Scene, *, field: IndexField | None = None, limits: str = "beam", strehl_node_count: int = 9
) -> EchoResult:
    """The echo that a scene's laser rangefinder receives, and the range that it reads.

    Args:
        scene: The scene.
        field: The refractive index, if it is made already; None: `prepare_field(scene).field`.
        limits: "beam": the beam's full support, or the reflector's edges where nearer; "paper": eq 11's cut at one
            radius either way in y, the whole beam in x.
        strehl_node_count: Points a side of the target at which the Strehl ratio is computed, odd; it is interpolated
            between them, and the error of that is in `information`.

    Returns:
        The echo. `receiver.ray_count` x `strehl_node_count`^2 rays are traced back, `beam.ray_count` out.

    Raises:
        ValueError: The target lies inside the flow or reaches back to the aperture, no ray gets out or arrives, or the
            echo in vacuum cannot be ranged (below the threshold, or too few samples).
    """
    flow = prepare_field(scene).field if field is None else field
    points = target_points(scene, limits)
    vacuum = vacuum_paths(points, target_plane(scene))
    out = transmit_paths(scene, flow, points)
    arrived = out.arrived
    if not arrived.any():
        raise ValueError(
            f"no ray of the beam reaches the target ({out.trace.status_summary() if out.trace else 'none traced'}): "
            "check receiver.aperture_z and beam.exit_radius against the body"
        )
    back = return_paths(scene, flow, out.landing, strehl_node_count)
    time, fine, stride = _record_times(scene, vacuum.path)

    reference_power = _point_power(scene, points.weight, vacuum, np.ones(len(points.weight)))
    reference, reference_voltage = _waveforms(scene, time, fine, stride, vacuum.path, reference_power)
    share = np.where(arrived, points.weight, 0.0)
    peak = np.where(arrived, _point_power(scene, points.weight, out, back.strehl), 0.0)
    power, voltage = _waveforms(scene, time, fine, stride, np.where(arrived, out.path, 0.0), peak)

    calibration = _calibrate(scene, time, reference_voltage)
    ranges = {}
    for method, offset in calibration.items():
        try:
            ranges[method] = _read(scene, time, voltage, method, reference_voltage) - offset
        except ValueError:  # the flow left too little of the echo for this method
            ranges[method] = math.nan
    traces = [result for result in (out.trace, back.trace) if result is not None]
    evaluations = [result.evaluation_count for result in traces]
    information = {
        "beam_share": float(share.sum()),
        "lost_share": float(points.weight.sum() - share.sum()),
        "strehl_error": back.error,
        "ray_count": sum(result.ray_count for result in traces),
        "evaluation_count": sum(int(np.sum(count)) for count in evaluations if count is not None),
        "trace_seconds": sum(result.seconds["total"] for result in traces),
    }
    return EchoResult(
        time=time,
        power=power,
        voltage=voltage,
        target_point=out.landing,
        path=out.path,
        incidence=np.arccos(np.clip(out.incidence_cosine, -1.0, 1.0)),
        strehl=back.strehl,
        beam_share=share,
        point_power=peak,
        distance=float(scene.target.distance),
        ranging=scene.detector.ranging,
        ranges=ranges,
        calibration=calibration,
        vacuum_peak_power=peak_height(reference),
        vacuum_peak_voltage=peak_height(reference_voltage),
        information=information,
    )


def _point_power(scene: Scene, weight: np.ndarray, paths: TransmitPaths, strehl: np.ndarray) -> np.ndarray:
    """Peak power of each point's pulse at the receiver [W], shape (m,)."""
    whole = plane_echo_power(
        scene.beam.peak_power,
        scene.receiver.diameter,
        paths.path,
        np.maximum(paths.incidence_cosine, 0.0),
        scene.target.reflectivity,
        scene.atmosphere.transmission,
        scene.receiver.efficiency,
    )
    return weight * strehl * whole


def _record_times(scene: Scene, path: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Sample times [s], times at which power is computed, and how many of these make one sample period.

    They follow from the geometry alone, so that scenes that differ in their flow have the same times.
    """
    delay = 2.0 * path / SPEED_OF_LIGHT
    margin = RECORD_MARGIN * scene.beam.pulse_tau
    tail = 0.0 if scene.detector.bandwidth is None else FILTER_MARGIN / scene.detector.bandwidth
    rate = scene.detector.sample_rate
    time = sample_times(delay.min() - margin, delay.max() + margin + tail, rate)
    stride = max(1, math.ceil(LEAST_RATE / (rate * scene.beam.pulse_tau)))
    fine = time[0] + np.arange((time.size - 1) * stride + 1) / (rate * stride)
    return time, fine, stride


def _waveforms(
    scene: Scene, time: np.ndarray, fine: np.ndarray, stride: int, path: np.ndarray, peak: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Power [W] and voltage [V] at the sample times, shape (n,) each."""
    detector = scene.detector
    power = sum_of_pulses(fine, 2.0 * path / SPEED_OF_LIGHT, peak, scene.beam.pulse_tau)
    voltage = detect(fine, power, volts_per_watt=detector.volts_per_watt, bandwidth=detector.bandwidth)
    return power[::stride][: time.size], voltage[::stride][: time.size]


def _read(scene: Scene, time: np.ndarray, voltage: np.ndarray, method: str, reference: np.ndarray) -> float:
    """Uncalibrated range [m]; the template of the matched filter is the echo in vacuum."""
    template = reference if method == "matched-filter" else None
    return estimate_range(
        time, voltage, method, threshold=scene.detector.threshold, template=template, fraction=scene.detector.fraction
    )


def _calibrate(scene: Scene, time: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Each method's error [m] on the echo in vacuum; one that cannot read it is left out, the scene's own refused."""
    offsets = {}
    for method in RANGING_METHODS:
        try:
            offsets[method] = _read(scene, time, reference, method, reference) - scene.target.distance
        except ValueError as fault:
            if method == scene.detector.ranging:
                raise ValueError(f"the echo in vacuum, without flow, cannot be ranged: {fault}") from None
    return offsets
