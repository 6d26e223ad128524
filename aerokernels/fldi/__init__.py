"""Focused laser differential interferometry: what a given instrument reads of a flow, and its transfer function."""

from .instrument import FLDI
from .response import FLDIResponse, fldi_response

__all__ = ["FLDI", "FLDIResponse", "fldi_response"]
