"""Simulate the echo of a scene: eq 9-12 of the paper as a sum over the beam in two dimensions.

    P(t) = sum over the rays i of  w_i P0 f_r cos(phi_i) (pi D^2 / 4) / R_i^2 eta_a^2 eta_s T_i^2 F_i s(t - 2 G_i / c)

w_i is the ray's fraction of the beam's power, R_i its optical path to the tilted target, G_i the group path (the paper
has R_i for both), phi_i its incidence, f_r the reflectance, s the pulse's shape, F_i the return factor of the point and
T_i the transmission of the flow's gas.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.focus import StrehlEstimate
from aerokernels.inputs.arguments import checked
from aerokernels.lidar.echo_errors import EchoProbe, echo_errors
from aerokernels.lidar.parts import Detector, Laser, Receiver, Setup, Target
from aerokernels.lidar.paths import air_error, point_power, still_air
from aerokernels.lidar.pulse_curve import peak_height
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, sum_of_pulses
from aerokernels.lidar.rangefinder import Rangefinder, VacuumEcho, cut_beam
from aerokernels.lidar.result import EchoResult
from aerokernels.lidar.return_paths import return_paths
from aerokernels.medium import IndexField
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene
from aerokernels.tracing.variants.causes import FACTOR


@checked
def echo(scene: Scene, *, field: IndexField | None = None, estimate: StrehlEstimate | None = None) -> EchoResult:
    """Simulate the echo that a scene's laser rangefinder receives, and the range that it reads.

    Args:
        scene: The scene.
        field: The refractive index, if it is prepared already; None: `prepare_field(scene).field`.
        estimate: A Strehl estimate of the scene through this field, whose rays are used when `error` is first read;
            None: some rays are traced then.

    Returns:
        The echo, with a range or the reason why there is none. `receiver.ray_count` x `strehl_node_count`^2 pairs of
        pupil and target points are traced back, in chunks of which only sums are stored; fewer pairs are traced if
        symmetry allows it. `beam.ray_count` rays go out, more where some of them are lost.

    Raises:
        ValueError: The target is inside the flow or reaches back to the aperture, no ray gets out or arrives, or a
            record of millions of samples.
    """
    flow = prepare_field(scene).field if field is None else field
    return echo_through(flow, VacuumEcho.of(Setup.of_scene(scene)), None if scene.has_own_pupil else estimate)


@checked
def simulate_echo(
    laser: Laser,
    target: Target,
    receiver: Receiver,
    detector: Detector,
    *,
    field: IndexField | None = None,
    **options: Any,
) -> EchoResult:
    """Simulate the echo that a laser rangefinder receives from a target, and the range that it reads.

    Args:
        laser: The laser.
        target: The target.
        receiver: The receiver.
        detector: The detector.
        field: The refractive index of the flow between receiver and target; None: vacuum.
        **options: As for `trace`: tolerance, method, backend, device, precision and others.

    Returns:
        The echo, with a range or the reason why there is none.

    Raises:
        ValueError: The target is inside the flow or reaches back to the aperture, no ray gets out or arrives, a record
            of millions of samples, or an option that `trace` refuses.
        TypeError: A part of another kind.

    Examples:
        >>> seen = simulate_echo(Laser(peak_power=75.0), Target(distance=1.5), Receiver(), Detector())
        >>> round(seen.range, 4)
        1.5
    """
    setup = Setup(laser, target, receiver, detector, {"wavelength": laser.wavelength} | options)
    if field is not None:
        return echo_through(field, VacuumEcho.of(setup))
    reach = 2.0 * receiver.pupil.reach
    origin, spacing = (0.0, receiver.aperture_z), (reach / 7.0, reach / 7.0)
    nothing = IndexField.from_samples(np.zeros((8, 8)), origin=origin, spacing=spacing, geometry="axisymmetric")
    return replace(echo_through(nothing, VacuumEcho.of(setup)), still_air=Quantity(0.0, 0.0, "m"))


def echo_through(flow: IndexField, vacuum: VacuumEcho, estimate: StrehlEstimate | None = None) -> EchoResult:
    """Simulate the echo through a field from the echo in vacuum; `estimate` is one of the receiver's pupil.

    Like a real rangefinder, each method is calibrated on the same scene's echo in vacuum. The remaining error is due to
    air and flow: mainly the range walk of a fixed threshold, and the group path of the air at rest.
    """
    setup, chain = vacuum.setup, vacuum.setup.detector.chain
    vacuum, out, lost_error = cut_beam(vacuum, flow)
    points, outward = vacuum.points, out.trace
    assert outward is not None and outward.evaluation_count is not None  # the flow was traced
    if not out.arrived.any():
        raise ValueError(
            f"no ray of the beam reaches the target ({outward.status_summary()}): "
            "check receiver.aperture_z and beam.exit_radius against the body"
        )
    back = return_paths(setup, flow, out.intersection)
    time, fine, stride = vacuum.times(out.group_path)

    reference = vacuum.power(fine)
    # The light returns through the gas by which it came.
    peak = np.where(out.arrived, point_power(setup, points.weight, out, back.factor) * outward.transmission**2, 0.0)
    delay = 2.0 * np.where(out.arrived, out.group_path, 0.0) / SPEED_OF_LIGHT
    power = sum_of_pulses(fine, delay, peak, setup.laser.shape)
    fine_voltage = chain.voltage(fine, reference)
    clean = chain.voltage(fine, power)[::stride]
    noisy, distance = setup.detector.noise, setup.target.distance
    voltage = chain.record(fine, power, setup.detector.seed, stride) if noisy else chain.digitise(clean)

    rangefinder = Rangefinder.calibrated(setup, fine, fine_voltage, stride)
    ranges, reasons = rangefinder.ranges(time, voltage)
    share = np.where(out.arrived, points.weight, 0.0)
    probe = EchoProbe(flow, estimate, vacuum, time, fine, stride, power, clean, rangefinder)
    return EchoResult(
        time=time,
        power=power[::stride],
        voltage=voltage,
        clean_voltage=clean,
        noise_rms=chain.noise_rms(0.0, setup.detector.sample_rate) if noisy else 0.0,
        target_point=out.intersection,
        path=out.path,
        group_path=out.group_path,
        deflection=out.deflection,
        incidence=np.arccos(np.clip(out.incidence_cosine, -1.0, 1.0)),
        strehl=back.strehl,
        return_factor=back.factor,
        beam_share=share,
        point_power=peak,
        distance=float(distance),
        still_air=Quantity(still_air(flow, distance), FACTOR * air_error(flow, distance), "m"),
        ranging=setup.detector.ranging,
        ranges=ranges,
        reasons=reasons,
        calibration=rangefinder.calibration,
        statistics=rangefinder.statistics(fine, power, stride, setup.detector.trial_count),
        vacuum_peak_power=peak_height(reference[::stride]),
        vacuum_peak_voltage=peak_height(fine_voltage[::stride]),
        vacuum_voltage=fine_voltage[::stride],
        information={
            "beam_share": float(share.sum()),
            "lost_share": float(points.weight.sum() - share.sum()),
            "lost_share_error": lost_error,
            "pair_count": back.pair_count,
            "ray_count": outward.ray_count + back.sums.ray_count,
            "evaluation_count": int(outward.evaluation_count.sum()) + back.sums.evaluation_count,
            "trace_seconds": outward.seconds["kernel"] + back.sums.seconds,
        },
        budget=partial(echo_errors, probe=probe),
    )
