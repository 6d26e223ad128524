"""Rays through a field: plan, trace, result and status, one module per backend."""

from .backend_info import BackendInfo
from .backends import available_backends
from .result import TraceResult
from .status import RayStatus
from .stop import ArcLength, Plane
from .trace import trace

__all__ = ["ArcLength", "BackendInfo", "Plane", "RayStatus", "TraceResult", "available_backends", "trace"]
