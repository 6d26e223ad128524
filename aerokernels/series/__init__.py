"""Optics of unsteady flows: maps of snapshots, their statistics, and maps over look angles."""

from .look import look_map
from .optical import optical_series
from .time_statistics import statistics

__all__ = ["look_map", "optical_series", "statistics"]
