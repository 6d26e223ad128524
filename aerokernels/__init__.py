"""aerokernels: light through the refractive index of supersonic air flow.

The public names; each is imported when it is first used, so that importing the package costs nothing. `echo`,
`schlieren`, `strehl` and `wavefront` are modules that can be called as the functions of these names: see
callable_module.py.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

# Where each name lives; "" for the modules.
_MODULE_OF = {
    "Annulus": "rays",
    "ArcLength": "tracing",
    "BackendInfo": "tracing",
    "Body": "medium",
    "Camera": "imaging",
    "DensityField": "flow",
    "Disc": "rays",
    "DotPattern": "imaging",
    "EchoResult": "echo",
    "FLDI": "fldi",
    "IndexField": "medium",
    "Mask": "rays",
    "Plane": "tracing",
    "Polygon": "rays",
    "QuadMesh": "medium",
    "RayBundle": "rays",
    "RayStatus": "tracing",
    "Rectangle": "rays",
    "RunResult": "jobs.run",
    "Scene": "scene",
    "Sensor": "sensor",
    "SolidBody": "medium",
    "StrehlEstimate": "strehl",
    "TraceResult": "tracing",
    "Validity": "waves",
    "Wave": "waves",
    "Wavefront": "wavefront",
    "available_backends": "tracing",
    "background_displacement": "imaging",
    "bos": "imaging",
    "compare_waveforms": "compare",
    "echo": "",
    "estimate_range": "echo",
    "estimate_strehl": "strehl_estimate",
    "field_to_vtk": "vtk_files",
    "fldi_response": "fldi",
    "flow": "",
    "image_through": "imaging",
    "interferogram": "schlieren",
    "look_map": "series",
    "optical_series": "series",
    "plane_target_echo": "echo",
    "point_spread_function": "wavefront",
    "prepare_strehl": "strehl_estimate",
    "range_statistics": "echo",
    "rays_to_vtk": "vtk_files",
    "schlieren": "",
    "shadowgraph": "schlieren",
    "simulate": "jobs.run",
    "split_step": "waves",
    "statistics": "series",
    "strehl": "",
    "strehl_marechal": "strehl",
    "sweep": "jobs.sweeps.run",
    "trace": "tracing",
    "validity": "waves",
    "wavefront": "",
    "zernike": "",
}

__all__ = [
    "FLDI",
    "Annulus",
    "ArcLength",
    "BackendInfo",
    "Body",
    "Camera",
    "DensityField",
    "Disc",
    "DotPattern",
    "EchoResult",
    "IndexField",
    "Mask",
    "Plane",
    "Polygon",
    "QuadMesh",
    "RayBundle",
    "RayStatus",
    "Rectangle",
    "RunResult",
    "Scene",
    "Sensor",
    "SolidBody",
    "StrehlEstimate",
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
    """Import a public name from the module that has it."""
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
    """The public names."""
    return [*__all__, "__version__"]


if TYPE_CHECKING:
    from . import flow, zernike
    from .compare import compare_waveforms
    from .echo import EchoResult, echo, estimate_range, plane_target_echo, range_statistics
    from .fldi import FLDI, fldi_response
    from .flow import DensityField
    from .imaging import Camera, DotPattern, background_displacement, bos, image_through
    from .jobs.run import RunResult, simulate
    from .jobs.sweeps.run import sweep
    from .medium import Body, IndexField, QuadMesh, SolidBody
    from .rays import Annulus, Disc, Mask, Polygon, RayBundle, Rectangle
    from .scene import Scene
    from .schlieren import interferogram, schlieren, shadowgraph
    from .sensor import Sensor
    from .series import look_map, optical_series, statistics
    from .strehl import StrehlEstimate, strehl, strehl_marechal
    from .strehl_estimate import estimate_strehl, prepare_strehl
    from .tracing import ArcLength, BackendInfo, Plane, RayStatus, TraceResult, available_backends
    from .tracing.trace import trace
    from .vtk_files import field_to_vtk, rays_to_vtk
    from .wavefront import Wavefront, point_spread_function, wavefront
    from .waves import Validity, Wave, split_step, validity
