"""Public names with their modules: for type checkers, and for `__getattr__` of the package, which imports them."""

from collections.abc import Callable, Mapping
from typing import Any

from . import flow as flow
from . import zernike as zernike
from .benches import interferogram as interferogram
from .benches import schlieren as schlieren
from .benches import shadowgraph as shadowgraph
from .compare import compare_waveforms as compare_waveforms
from .fldi import FLDI as FLDI
from .fldi import fldi_response as fldi_response
from .flow import DensityField as DensityField
from .focus import StrehlEstimate as StrehlEstimate
from .focus import strehl as strehl
from .focus import strehl_marechal as strehl_marechal
from .focus.estimate import estimate_strehl as estimate_strehl
from .focus.estimate import prepare_strehl as prepare_strehl
from .imaging import Camera as Camera
from .imaging import DotPattern as DotPattern
from .imaging import background_displacement as background_displacement
from .imaging import bos as bos
from .imaging import image_through as image_through
from .jobs.run import simulate as simulate
from .jobs.run_files import RunResult as RunResult
from .jobs.sweeps.run import sweep as sweep
from .lidar import Detector as Detector
from .lidar import EchoResult as EchoResult
from .lidar import Laser as Laser
from .lidar import Receiver as Receiver
from .lidar import Target as Target
from .lidar import echo as echo
from .lidar import estimate_range as estimate_range
from .lidar import plane_target_echo as plane_target_echo
from .lidar import range_statistics as range_statistics
from .lidar import simulate_echo as simulate_echo
from .medium import Body as Body
from .medium import IndexField as IndexField
from .medium import QuadMesh as QuadMesh
from .medium import SolidBody as SolidBody
from .rays import Annulus as Annulus
from .rays import Disc as Disc
from .rays import Mask as Mask
from .rays import Polygon as Polygon
from .rays import RayBundle as RayBundle
from .rays import Rectangle as Rectangle
from .scene import Scene as Scene
from .sensor import Sensor as Sensor
from .series import look_map as look_map
from .series import optical_series as optical_series
from .series import statistics as statistics
from .tracing import ArcLength as ArcLength
from .tracing import BackendInfo as BackendInfo
from .tracing import Plane as Plane
from .tracing import RayStatus as RayStatus
from .tracing import TraceOptions as TraceOptions
from .tracing import TraceResult as TraceResult
from .tracing import available_backends as available_backends
from .tracing.trace import trace as trace
from .vtk_files import field_to_vtk as field_to_vtk
from .vtk_files import rays_to_vtk as rays_to_vtk
from .wavefronts import Wavefront as Wavefront
from .wavefronts import point_spread_function as point_spread_function
from .wavefronts.traced import compare_wavefronts as compare_wavefronts
from .wavefronts.traced import wavefront as wavefront
from .waves import Validity as Validity
from .waves import Wave as Wave
from .waves import split_step as split_step
from .waves import validity as validity

__version__: str

def attributes_of(package: str, module_of: Mapping[str, str]) -> Callable[[str], Any]: ...
