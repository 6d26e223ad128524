"""Call public functions with one argument replaced by an unsuitable value, and count the outcomes.

A call may answer, or refuse: a ValueError or TypeError that a statement of this package raises, in words. Any other
outcome is a fault: another exception, or one of Python's or NumPy's own that passed through.
"""

import gc
import inspect
import itertools
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aerokernels import flow, zernike
from aerokernels.benches import interferogram, shadowgraph
from aerokernels.benches.knife_edge import schlieren
from aerokernels.compare import compare_waveforms
from aerokernels.focus import strehl, strehl_marechal
from aerokernels.focus.estimate import estimate_strehl
from aerokernels.lidar import estimate_range, plane_target_echo, range_statistics
from aerokernels.medium import Body, IndexField, QuadMesh, SolidBody
from aerokernels.rays import Annulus, Disc, Mask, Polygon, RayBundle, Rectangle
from aerokernels.scene import Scene
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.trace import trace
from aerokernels.wavefronts import Wavefront, point_spread_function
from aerokernels.wavefronts.traced import wavefront
from aerokernels.waves import Wave, angular_spectrum, split_step, validity

from .refusals import attempt

# Unsuitable values by name.
WRONG: dict[str, Any] = {
    "text with a unit": "6 mm",
    "text": "abc",
    "bytes": b"x",
    "1e300": 1e300,
    "-1e300": -1e300,
    "1e-300": 1e-300,
    "0": 0,
    "-1": -1,
    "1.5": 1.5,
    "nan": float("nan"),
    "inf": float("inf"),
    "10**400": 10**400,
    "complex": 1 + 2j,
    "True": True,
    "False": False,
    "None": None,
    "empty list": [],
    "dict": {},
    "object": object(),
    "class": float,
    "function": len,
    "complex array": np.array([1.0, 2j]),
    "text array": np.array(["a", "b"]),
    "ragged": [[1.0, 2.0], [3.0]],
    "empty array": np.zeros((0, 3)),
    "numbers": [1.0, 2.0],
    "nan array": np.array([np.nan, 1.0, 1.0]),
    "1e300 array": np.array([1e300, 1e300, -1e300]),
}


@dataclass
class Tally:
    """Counts of the outcomes.

    Attributes:
        answered: Calls that gave a result.
        refused: Calls refused in words.
        faults: Other outcomes: the call, the argument, the value given, and the exception.
    """

    answered: int = 0
    refused: int = 0
    faults: list[tuple[str, str, str, str]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of all calls."""
        return self.answered + self.refused + len(self.faults)


def calls() -> dict[str, tuple[Callable, dict[str, Any]]]:
    """Public functions and classes, by name, each with valid values for all of its arguments."""
    return {name: (function, {**_defaults(function), **given}) for name, (function, given) in _right_calls().items()}


def _defaults(function: Callable) -> dict[str, Any]:
    parameters = inspect.signature(function).parameters.values()
    return {one.name: one.default for one in parameters if one.default is not one.empty}


def _right_calls() -> dict[str, tuple[Callable, dict[str, Any]]]:
    """Public functions and classes, with the arguments that have no default, or a slow one."""
    disc = Disc(2e-3, (0, 0, 0))
    r, z = np.linspace(0.0, 4e-3, 9), np.linspace(0.0, 8e-3, 17)
    contrast = 1e-6 * np.exp(-(((z[None, :] - 4e-3) / 2e-3) ** 2)) * np.ones((9, 1))
    grid = {"origin": (0.0, 0.0), "spacing": (5e-4, 5e-4), "geometry": "axisymmetric", "ambient_index": 1.0}
    air = IndexField.from_samples(contrast, **grid)
    first, second = np.meshgrid(r, z, indexing="ij")
    mesh = QuadMesh.structured(first, second, "axisymmetric")
    time = np.arange(64) * 1e-10
    pulse = np.exp(-(((time - 3e-9) / 5e-10) ** 2))
    opd = 1e-8 * np.add.outer(np.arange(8.0), np.arange(8.0))
    wave = Wavefront(opd, np.ones((8, 8)), 1e-3, 905e-9)
    body = Body([(0, 0), (1e-3, 0), (1e-3, 1e-3)], "axisymmetric")
    solid = SolidBody.of_revolution(body, 8)
    rays = RayBundle.collimated(disc, 4)
    target = {"peak_power": 75.0, "receiver_diameter": 0.012, "beam_radius": 0.01, "distance": 1.5, "tilt": 0.0,
              "pulse_tau": 6e-9, "reflectivity": 0.3}  # fmt: skip
    found: dict[str, tuple[Callable, dict[str, Any]]] = {
        "Disc": (Disc, {"radius": 6e-3, "center": (0, 0, 0), "normal": (0, 0, 1)}),
        "Annulus": (Annulus, {"radius": 6e-3, "inner_radius": 1e-3, "center": (0, 0, 0), "normal": (0, 0, 1)}),
        "Rectangle": (Rectangle, {"width": 6e-3, "height": 1e-3, "center": (0, 0, 0), "normal": (0, 0, 1)}),
        "Polygon": (Polygon, {"vertices": [(0, 0), (1e-3, 0), (0, 1e-3)], "center": (0, 0, 0), "normal": (0, 0, 1)}),
        "Mask": (Mask, {"weights": np.ones((3, 3)), "pixel": 1e-3, "center": (0, 0, 0), "normal": (0, 0, 1)}),
        "Plane": (Plane, {"point": (0, 0, 0), "normal": (0, 0, 1)}),
        "ArcLength": (ArcLength, {"length": 0.1}),
        "Body": (Body, {"profile": [(0, 0), (1e-3, 0), (1e-3, 1e-3)], "geometry": "axisymmetric"}),
        "RayBundle": (RayBundle, {"position": [[0, 0, 0]], "direction": [[0, 0, 1]], "weight": [1.0]}),
        "RayBundle.collimated": (RayBundle.collimated, {"pupil": disc, "ray_count": 4}),
        "RayBundle.divergent": (
            RayBundle.divergent,
            {"apex": (0, 0, 0), "axis": (0, 0, 1), "half_angle": 0.1, "ray_count": 4},
        ),
        "RayBundle.through": (RayBundle.through, {"pupil": disc, "from_point": (0, 0, -1), "ray_count": 4}),
        "QuadMesh": (QuadMesh, {"vertices": mesh.vertices, "cells": mesh.cells, "geometry": "planar"}),
        "QuadMesh.locate": (mesh.locate, {"points": [[1e-3, 1e-3]]}),
        "Body.crossings": (body.crossings, {"position": [[0, 0, 0]], "direction": [[0, 0, 1]]}),
        "Body.signed_distance": (body.signed_distance, {"points": [[1e-3, 1e-3]]}),
        "SolidBody": (SolidBody, {"vertices": solid.vertices, "triangles": solid.triangles}),
        "SolidBody.of_revolution": (SolidBody.of_revolution, {"body": body, "count": 8}),
        "SolidBody.crossings": (solid.crossings, {"position": [[0, 0, 0]], "direction": [[0, 0, 1]]}),
        "SolidBody.signed_distance": (solid.signed_distance, {"points": [[0, 0, 1e-3]]}),
        "Transfer.along": (wave.mtf().along, {"angle": 0.1}),
        "EncircledEnergy.radius": (wave.encircled_energy().radius, {"share": 0.5}),
        "Wave": (Wave, {"amplitude": np.ones((8, 8)), "pixel": 1e-3, "wavelength": 905e-9}),
        "Wave.psf": (Wave(np.ones((8, 8)), 1e-3, 905e-9).psf, {"angle": [0.0]}),
        "angular_spectrum": (
            angular_spectrum,
            {"amplitude": np.ones((8, 8)), "pixel": 1e-3, "wavelength": 905e-9, "distance": 0.1},
        ),
        "QuadMesh.structured": (QuadMesh.structured, {"first": first, "second": second, "geometry": "planar"}),
        "IndexField.from_samples": (IndexField.from_samples, {"contrast": contrast, **grid, "wavelength": 905e-9}),
        "IndexField.from_mesh": (IndexField.from_mesh, {"mesh": mesh, "contrast": contrast, "wavelength": 905e-9}),
        "IndexField.resample": (air.resample, {"spacing": 1e-3, "region": ((0, 0), (4e-3, 8e-3))}),
        "IndexField.evaluate": (air.evaluate, {"points": [[0, 0, 1e-3]]}),
        "IndexField.contrast_at": (air.contrast_at, {"points": [[0, 0, 1e-3]]}),
        "IndexField.with_interpolation": (air.with_interpolation, {"interpolation": "linear"}),
        "strehl": (strehl, {"opd": opd, "wavelength": 905e-9, "remove": ("piston", "tilt")}),
        "strehl_marechal": (strehl_marechal, {"opd": opd, "wavelength": 905e-9}),
        "point_spread_function": (
            point_spread_function,
            {"opd": opd, "mask": np.ones((8, 8)), "pixel": 1e-3, "wavelength": 905e-9, "padding": 2},
        ),
        "zernike_polynomial": (zernike.zernike_polynomial, {"n": 2, "m": 0, "x": [0.1], "y": [0.1]}),
        "zernike_modes": (zernike.zernike_modes, {"count": 3, "x": [0.1], "y": [0.1]}),
        "noll_to_nm": (zernike.noll_to_nm, {"index": 4}),
        "estimate_range": (
            estimate_range,
            {"time": time, "voltage": pulse, "method": "leading-edge", "threshold": 0.5},
        ),
        "compare_waveforms": (
            compare_waveforms,
            {"time": time, "recorded": pulse, "simulated": pulse, "greatest_lag": 1e-9, "threshold": 0.1},
        ),
        "plane_target_echo": (plane_target_echo, {"time": time + 1e-8, **target}),
        "range_statistics": (
            range_statistics,
            {
                "time": time,
                "voltage": pulse,
                "method": "constant-fraction",
                "noise_rms": 0.01,
                "true_range": 0.4,
                "trial_count": 10,
            },
        ),
        "trace": (trace, {"field": air, "rays": rays, "method": "straight"}),
        "estimate_strehl": (estimate_strehl, {"field": air, "pupil": disc, "ray_count": 64, "allow_truncation": True}),
        "wavefront": (wavefront, {"field": air, "pupil": disc, "pixel_count": 16, "allow_truncation": True}),
        "schlieren": (schlieren, {"field": air, "pixel_count": 8}),
        "shadowgraph": (shadowgraph, {"field": air, "pixel_count": 8, "distance": 0.5}),
        "interferogram": (interferogram, {"field": air, "pixel_count": 8, "fringe_spacing": 4e-3, "fringe_angle": 0.1}),
        "split_step": (split_step, {"field": air, "light": disc, "pixel_count": 16, "step_count": 2}),
        "validity": (validity, {"field": air, "pupil": disc, "waves": True}),
        "Scene.load": (Scene.load, {"place": "wind-tunnel-static"}),
    }
    uniform = flow.uniform_air(1.2, radius=4e-3, z_range=(0.0, 8e-3))
    found |= {
        "flow.uniform_air": (flow.uniform_air, {"density": 1.2}),
        "flow.index_field": (uniform.index_field, {}),
        "flow.scaled": (uniform.scaled, {"ambient_density": 1.0}),
        "flow.density_at": (uniform.density_at, {"points": [[0, 0, 1e-3]]}),
        "flow.shipped": (flow.shipped, {"name": "mach3"}),
        "flow.wedge": (flow.wedge, {"mach": 3.0, "half_angle": 0.1, "spacing": 5e-3}),
        "flow.cone": (flow.cone, {"mach": 3.0, "half_angle": 0.1}),
        "flow.isentropic": (flow.isentropic, {"mach": 3.0}),
        "flow.free_stream": (flow.free_stream, {"mach": 3.0}),
        "flow.tunnel_conditions": (flow.tunnel_conditions, {"mach": 3.0, "stagnation_pressure": 6e5,
                                   "stagnation_temperature": 288.0}),
        "flow.normal_shock": (flow.normal_shock, {"mach": 3.0}),
        "flow.oblique_shock": (flow.oblique_shock, {"mach": 3.0, "deflection": 0.1}),
        "flow.prandtl_meyer": (flow.prandtl_meyer, {"mach": 3.0}),
        "flow.expansion_fan": (flow.expansion_fan, {"mach": 3.0, "deflection": 0.1}),
        "flow.cone_shock": (flow.cone_shock, {"mach": 3.0, "half_angle": 0.1}),
        "flow.bow_shock": (flow.bow_shock, {"mach": 3.0, "radius": 0.01, "geometry": "planar"}),
        "flow.index_contrast": (flow.index_contrast, {"density": 1.0, "ambient_density": 1.2,
                                "gladstone_dale": 2.25e-4}),
        "flow.gladstone_dale_constant": (flow.gladstone_dale_constant, {"wavelength": 905e-9}),
        "flow.moist_air_density": (flow.moist_air_density, {"temperature": 288.0, "pressure": 1e5}),
        "flow.water_fraction": (flow.water_fraction, {"temperature": 288.0, "pressure": 1e5, "humidity": 0.5}),
        "flow.ciddor_refractivity": (flow.ciddor_refractivity, {"wavelength": 905e-9, "temperature": 288.0,
                                     "pressure": 1e5}),
        "flow.species_constant": (flow.species_constant, {"name": "N2", "wavelength": 905e-9}),
        "flow.refractivity_model": (flow.refractivity_model, {"constant": 2.25e-4}),
    }  # fmt: skip
    return found


def draws(made: dict[str, tuple[Callable, dict[str, Any]]], seed: int | None = None) -> Iterator[tuple[str, str, str]]:
    """Name of the call, argument and unsuitable value: each combination once, or at random without end from a seed."""
    each = [(name, key, wrong) for name, (_, given) in made.items() for key in given for wrong in WRONG]
    if seed is None:
        yield from each
        return
    generator = random.Random(seed)
    while True:
        yield generator.choice(each)


# Calls that trace rays or generate noise: hundredths of a second each.
SLOW = (
    "trace", "estimate_strehl", "wavefront", "schlieren", "shadowgraph", "interferogram", "split_step", "validity",
    "range_statistics",
)  # fmt: skip


def run(limit: int | None = None, seed: int | None = None, leave_out: tuple[str, ...] = ()) -> Tally:
    """Make calls and count their outcomes.

    Args:
        limit: Number of calls after which to stop; None for all combinations once.
        seed: Seed of a random order; None for the given order.
        leave_out: Names of calls that are left out.
    """
    made = {name: call for name, call in calls().items() if name not in leave_out}
    tally = Tally()
    for name, key, wrong in itertools.islice(draws(made, seed), limit):
        function, given = made[name]
        fault = attempt(function, {**given, key: WRONG[wrong]})
        if fault is None:
            tally.answered += 1
        elif fault == "":
            tally.refused += 1
        else:
            tally.faults.append((name, key, wrong, fault))
    gc.collect()
    return tally
