"""Focused laser differential interferometry (FLDI): response of an instrument to a flow, and its transfer function."""

from .instrument import FLDI
from .response import FLDIResponse, fldi_response

__all__ = ["FLDI", "FLDIResponse", "fldi_response"]
