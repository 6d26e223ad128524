"""Wave optics: a split-step wave through the same field as the rays, and a verdict on the validity of ray optics."""

from .split_step import split_step
from .validity import Validity, validity
from .wave import Wave, WrappedWaveWarning, angular_spectrum

__all__ = ["Validity", "Wave", "WrappedWaveWarning", "angular_spectrum", "split_step", "validity"]
