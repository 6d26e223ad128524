"""Compute the Strehl ratio of a wavefront, or estimate it over a pupil of millions of rays (`estimate`)."""

from .ratio import StrehlEstimate, strehl, strehl_marechal

__all__ = ["StrehlEstimate", "strehl", "strehl_marechal"]
