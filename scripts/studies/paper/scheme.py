"""The paper's step rule and its whole scheme on the shipped flows, beside ours, on the flows' own meshes.

Steps   eq 5, fixed steps of the same mean count, and error control, in one field (bilinear): errors of the OPD against
        error control at a thousandth of the tolerance
Echo    eq 5, 6 and 7 from end to end: echo peaks by `grid.route = "mesh"`, `grid.interpolation = "idw"` and
        `trace.method = "paper"`, beside those by the shipped scene
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels import flow
from aerokernels.lidar.simulate import echo
from aerokernels.medium import IndexField
from aerokernels.prepare import prepare_field
from aerokernels.rays import RayBundle
from aerokernels.scene import Scene
from aerokernels.tracing import TraceResult, trace

from .cases import scene_name

WAVELENGTH = 905e-9  # [m]
PUPIL = 6e-3, -8e-3  # radius of the shipped scenes' pupil, and its z [m]
TOLERANCE = 1e-3  # of error control [waves]
# Fixed steps hit or miss shocks by chance: the mean over steps of these lengths, relative to that of eq 5's count.
LENGTHS = np.linspace(0.95, 1.05, 5)
SCHEMES: dict[str, dict[str, str]] = {
    "ours": {},
    "bilinear": {"grid.route": "mesh", "trace.method": "paper"},
    "paper": {"grid.route": "mesh", "grid.interpolation": "idw", "trace.method": "paper"},
    "idw, error control": {"grid.route": "mesh", "grid.interpolation": "idw"},
}


@dataclass(frozen=True)
class Steps:
    """Mean steps a ray, and rms error of the OPD [waves], by rule: "eq 5", "fixed" and "adaptive"."""

    count: dict[str, float]
    error: dict[str, float]


def step_rules(mach: int, ray_count: int) -> Steps:
    """Trace a shipped flow from the pupil forward by each rule of steps, in float64 so that rounding does not show."""
    field = flow.shipped(f"mach{mach}").index_field(WAVELENGTH, "paper")
    radius, z = PUPIL
    order = np.arange(ray_count)
    distance, angle = radius * np.sqrt((order + 0.5) / ray_count), order * np.pi * (3.0 - np.sqrt(5.0))
    start = np.stack([distance * np.cos(angle), distance * np.sin(angle), np.full(ray_count, z)], axis=1)
    rays = RayBundle(start, np.tile((0.0, 0.0, 1.0), (ray_count, 1)))

    def traced(**rule: Any) -> TraceResult:
        return trace(field, rays, precision="float64", bundle="off", **rule)

    exact = traced(method="adaptive", tolerance=1e-3 * TOLERANCE).opd
    found = {"eq 5": [traced(method="paper")], "adaptive": [traced(method="adaptive", tolerance=TOLERANCE)]}
    step = _step_of_count(field, traced, float(found["eq 5"][0].step_count.mean()))
    found["fixed"] = [traced(method="fixed", step=step * length) for length in LENGTHS]
    return Steps(
        {rule: float(np.mean([one.step_count.mean() for one in tried])) for rule, tried in found.items()},
        {
            rule: float(np.mean([np.sqrt(np.mean((one.opd - exact) ** 2)) for one in tried]) / WAVELENGTH)
            for rule, tried in found.items()
        },
    )


def _step_of_count(field: IndexField, traced, count: float) -> float:
    """Length of fixed steps [m] of which a ray takes `count` in the mean; parts without flow are one step each."""
    step = float(np.median(field.mesh.cell_size))
    for _ in range(8):
        step *= float(traced(method="fixed", step=step).step_count.mean()) / count
    return step


def scheme_peaks(density: str, mach: int, pupil_rays: int) -> dict[str, float]:
    """Echo peak [V] of a shipped scene by each of `SCHEMES`."""
    peaks = {}
    for name, settings in SCHEMES.items():
        scene = Scene.load(scene_name(density, mach), {"receiver.ray_count": pupil_rays} | settings)
        peaks[name] = echo(scene, field=prepare_field(scene).field).peak_voltage
    return peaks
