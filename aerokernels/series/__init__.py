"""Optics of flows in time: maps of snapshots, their statistics, and maps over look angles."""

from .optical import optical_series
from .time_statistics import statistics

__all__ = ["optical_series", "statistics"]
