"""Trace rays through a field: plan, trace, result and status. The backends are in engines/."""

from .engines.choice import available_backends
from .engines.info import BackendInfo
from .plan import TraceOptions
from .result import TraceResult
from .stop import ArcLength, Plane, RayStatus
from .trace import trace

__all__ = [
    "ArcLength",
    "BackendInfo",
    "Plane",
    "RayStatus",
    "TraceOptions",
    "TraceResult",
    "available_backends",
    "trace",
]
