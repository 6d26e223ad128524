"""aerokernels: light through the refractive index of supersonic air flow.

Each public name is imported when it is first used, so that importing the package takes no time.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

# Public names by module; "" lists the public modules.
_NAMES_IN = {
    "": ("flow", "zernike"),
    "benches": ("interferogram", "schlieren", "shadowgraph"),
    "compare": ("compare_waveforms",),
    "fldi": ("FLDI", "fldi_response"),
    "flow": ("DensityField",),
    "focus": ("StrehlEstimate", "strehl", "strehl_marechal"),
    "focus.estimate": ("estimate_strehl", "prepare_strehl"),
    "imaging": ("Camera", "DotPattern", "background_displacement", "bos", "image_through"),
    "jobs.run": ("simulate",),
    "jobs.run_files": ("RunResult",),
    "jobs.sweeps.run": ("sweep",),
    "lidar": (
        "Detector",
        "EchoResult",
        "Laser",
        "Receiver",
        "Target",
        "echo",
        "estimate_range",
        "plane_target_echo",
        "range_statistics",
        "simulate_echo",
    ),
    "medium": ("Body", "IndexField", "QuadMesh", "SolidBody"),
    "rays": ("Annulus", "Disc", "Mask", "Polygon", "RayBundle", "Rectangle"),
    "scene": ("Scene",),
    "sensor": ("Sensor",),
    "series": ("look_map", "optical_series", "statistics"),
    "tracing": (
        "ArcLength",
        "BackendInfo",
        "Plane",
        "RayStatus",
        "TraceOptions",
        "TraceResult",
        "available_backends",
        "trace",
    ),
    "vtk_files": ("field_to_vtk", "rays_to_vtk"),
    "wavefronts": ("Wavefront", "point_spread_function"),
    "wavefronts.traced": ("wavefront",),
    "waves": ("Validity", "Wave", "split_step", "validity"),
}
_MODULE_OF = {name: module for module, names in _NAMES_IN.items() for name in names}

__all__ = [
    "FLDI",
    "Annulus",
    "ArcLength",
    "BackendInfo",
    "Body",
    "Camera",
    "DensityField",
    "Detector",
    "Disc",
    "DotPattern",
    "EchoResult",
    "IndexField",
    "Laser",
    "Mask",
    "Plane",
    "Polygon",
    "QuadMesh",
    "RayBundle",
    "RayStatus",
    "Receiver",
    "Rectangle",
    "RunResult",
    "Scene",
    "Sensor",
    "SolidBody",
    "StrehlEstimate",
    "Target",
    "TraceOptions",
    "TraceResult",
    "Validity",
    "Wave",
    "Wavefront",
    "available_backends",
    "background_displacement",
    "bos",
    "compare_waveforms",
    "echo",
    "estimate_range",
    "estimate_strehl",
    "field_to_vtk",
    "fldi_response",
    "flow",
    "image_through",
    "interferogram",
    "look_map",
    "optical_series",
    "plane_target_echo",
    "point_spread_function",
    "prepare_strehl",
    "range_statistics",
    "rays_to_vtk",
    "schlieren",
    "shadowgraph",
    "simulate",
    "simulate_echo",
    "split_step",
    "statistics",
    "strehl",
    "strehl_marechal",
    "sweep",
    "trace",
    "validity",
    "wavefront",
    "zernike",
]


def __getattr__(name: str):
    """Import a public name from its module."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'aerokernels' has no attribute {name!r}")
    module = _MODULE_OF[name]
    if not module:
        value = import_module(f".{name}", __name__)
    else:
        value = getattr(import_module(f".{module}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return [*__all__, "__version__"]


if TYPE_CHECKING:
    from . import flow, zernike
    from .benches import interferogram, schlieren, shadowgraph
    from .compare import compare_waveforms
    from .fldi import FLDI, fldi_response
    from .flow import DensityField
    from .focus import StrehlEstimate, strehl, strehl_marechal
    from .focus.estimate import estimate_strehl, prepare_strehl
    from .imaging import Camera, DotPattern, background_displacement, bos, image_through
    from .jobs.run import simulate
    from .jobs.run_files import RunResult
    from .jobs.sweeps.run import sweep
    from .lidar import (
        Detector,
        EchoResult,
        Laser,
        Receiver,
        Target,
        echo,
        estimate_range,
        plane_target_echo,
        range_statistics,
        simulate_echo,
    )
    from .medium import Body, IndexField, QuadMesh, SolidBody
    from .rays import Annulus, Disc, Mask, Polygon, RayBundle, Rectangle
    from .scene import Scene
    from .sensor import Sensor
    from .series import look_map, optical_series, statistics
    from .tracing import ArcLength, BackendInfo, Plane, RayStatus, TraceOptions, TraceResult, available_backends
    from .tracing.trace import trace
    from .vtk_files import field_to_vtk, rays_to_vtk
    from .wavefronts import Wavefront, point_spread_function
    from .wavefronts.traced import wavefront
    from .waves import Validity, Wave, split_step, validity
