"""Simulate the echo of a scene: eq 9-12 of the paper as a sum over the beam in two dimensions.

    P(t) = sum over the rays i of  w_i P0 f_r cos(phi_i) (pi D^2 / 4) / R_i^2 eta_a^2 eta_s F_i s(t - 2 G_i / c)

w_i is the fraction of the beam's power in ray i, R_i its optical path to the tilted target and G_i the group path along
the same ray, by which the pulse travels (the paper has R_i for both), phi_i its incidence there,
f_r the reflectance toward the receiver (reflectors.py), s the pulse's shape (pulses.py), and F_i the return factor of
the point where the ray meets the target: the Strehl ratio of its return path, as in the paper, or another
(return_paths.py). The return path has the same lengths as the outward path. R_i in R_i^2 is an optical path too,
as in eq 10: 5e-4 of the power at sea level. Path, incidence and return factor are those of the point where the
refracted ray meets the target. Which rays meet the reflector is decided without the flow: the flow displaces rays by
0.1 mm, which matters at the edges only. Where rays are lost, as behind a body, the beam has more points (cut_beam.py).

Like a real rangefinder, each method is calibrated on a known echo, the same scene's echo in vacuum: the error of the
reading of this echo is subtracted. The remaining error is due to air and flow: mainly the range walk of a fixed
threshold with the amplitude, and the group path of the air at rest between aperture and target (0.4 mm over 1.5 m at
sea level), which is no effect of the flow.
"""

from functools import partial

import numpy as np

from ..display.quantities import Quantity
from ..inputs.arguments import checked
from ..medium import IndexField
from ..prepare import prepare_field
from ..scene import Scene
from ..strehl import StrehlEstimate
from ..tracing.variants.causes import FACTOR
from .cut_beam import cut_beam
from .echo_errors import EchoProbe, echo_errors
from .paths import TransmitPaths, air_error, still_air
from .pulse_curve import PulseCurve, peak_height
from .rangefinder import Rangefinder
from .received_power import point_power
from .result import EchoResult
from .return_paths import return_paths
from .vacuum import VacuumEcho
from .waveform import SPEED_OF_LIGHT, sum_of_pulses


@checked
def echo(
    scene: Scene,
    *,
    field: IndexField | None = None,
    limits: str | None = None,
    strehl_node_count: int | str | None = None,
    symmetry: bool = True,
    estimate: StrehlEstimate | None = None,
) -> EchoResult:
    """Simulate the echo that a scene's laser rangefinder receives, and the range that it reads.

    Args:
        scene: The scene.
        field: The refractive index, if it is prepared already; None: `prepare_field(scene).field`.
        limits: "beam": the beam's full support, or the reflector's edges where nearer; "paper": eq 11's limit of one
            radius either way in y, the whole beam in x; None: the scene's `target.limits`.
        strehl_node_count: Number of points along each side of the target at which the return factor is computed, odd;
            the factor is interpolated between them. "every": at each target point.
            None: the scene's.
        symmetry: Whether to use the symmetry of field, pupil and target about the axis, if there is one.
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
    return echo_through(flow, VacuumEcho.of(scene, limits), strehl_node_count, symmetry, estimate)


def echo_through(
    flow: IndexField,
    vacuum: VacuumEcho,
    strehl_node_count: int | str | None = None,
    symmetry: bool = True,
    estimate: StrehlEstimate | None = None,
) -> EchoResult:
    """Simulate the echo through a field from the echo in vacuum; the other arguments and errors are those of `echo`."""
    scene, pulse, chain = vacuum.scene, vacuum.pulse, vacuum.chain
    vacuum, out, lost_error = cut_beam(vacuum, flow)
    points = vacuum.points
    if not out.arrived.any():
        raise ValueError(
            f"no ray of the beam reaches the target ({out.trace.status_summary() if out.trace else 'none traced'}): "
            "check receiver.aperture_z and beam.exit_radius against the body"
        )
    node_count = scene.receiver.strehl_node_count if strehl_node_count is None else strehl_node_count
    back = return_paths(scene, flow, out.intersection, vacuum.plane, node_count, symmetry)
    time, fine, stride = vacuum.times(out.group_path)

    reference = vacuum.power(fine)
    peak = np.where(out.arrived, point_power(scene, points.weight, out, back.factor), 0.0)
    power = sum_of_pulses(fine, 2.0 * np.where(out.arrived, out.group_path, 0.0) / SPEED_OF_LIGHT, peak, pulse)
    fine_voltage = chain.voltage(fine, reference)
    reference_voltage = fine_voltage[::stride]
    clean = chain.voltage(fine, power)[::stride]
    noisy = scene.detector.noise
    voltage = chain.record(fine, power, scene.detector.seed, stride) if noisy else chain.digitise(clean)

    curves = PulseCurve.of_each([reference[::stride], reference_voltage, voltage])
    rangefinder = Rangefinder.calibrated(scene, time, reference_voltage, (fine, fine_voltage), curves[1])
    ranges, reasons = rangefinder.ranges(time, voltage, curve=curves[2])
    share = np.where(out.arrived, points.weight, 0.0)

    peaks = peak_height(reference[::stride], curves[0]), peak_height(reference_voltage, curves[1])

    probe = EchoProbe(
        field=flow,
        estimate=estimate,
        vacuum=vacuum,
        time=time,
        fine=fine,
        stride=stride,
        power=power,
        clean=clean,
        rangefinder=rangefinder,
    )
    return EchoResult(
        time=time,
        power=power[::stride],
        voltage=voltage,
        clean_voltage=clean,
        noise_rms=chain.noise_rms(0.0, scene.detector.sample_rate) if noisy else 0.0,
        target_point=out.intersection,
        path=out.path,
        group_path=out.group_path,
        deflection=out.deflection,
        incidence=np.arccos(np.clip(out.incidence_cosine, -1.0, 1.0)),
        strehl=back.strehl,
        return_factor=back.factor,
        beam_share=share,
        point_power=peak,
        distance=float(scene.target.distance),
        still_air=Quantity(
            still_air(flow, scene.target.distance), FACTOR * air_error(flow, scene.target.distance), "m"
        ),
        ranging=scene.detector.ranging,
        ranges=ranges,
        reasons=reasons,
        calibration=rangefinder.calibration,
        statistics=rangefinder.statistics(scene, fine, power, stride, scene.detector.trial_count),
        vacuum_peak_power=peaks[0],
        vacuum_peak_voltage=peaks[1],
        information=_information(points.weight, share, out, back) | {"lost_share_error": lost_error},
        budget=partial(echo_errors, probe=probe),
    )


def _information(weight: np.ndarray, share: np.ndarray, out: TransmitPaths, back) -> dict[str, float]:
    """Return numbers about the computation."""
    outward = out.trace
    assert outward is not None  # the flow was traced
    evaluations = 0 if outward.evaluation_count is None else int(np.sum(outward.evaluation_count))
    return {
        "beam_share": float(share.sum()),
        "lost_share": float(weight.sum() - share.sum()),
        "pair_count": back.pair_count,
        "ray_count": outward.ray_count + (back.sums.ray_count if back.sums else 0),
        "evaluation_count": evaluations + (back.sums.evaluation_count if back.sums else 0),
        "trace_seconds": outward.seconds["kernel"] + (back.sums.seconds if back.sums else 0.0),
    }
