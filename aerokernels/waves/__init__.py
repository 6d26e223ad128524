"""Wave optics: a split-step wave through the same field as the rays, and a verdict on the validity of ray optics."""

from .angular_spectrum import angular_spectrum
from .split_step import split_step
from .validity import validity
from .verdict import Validity
from .wave import Wave
from .wrapping import WrappedWaveWarning

__all__ = ["Validity", "Wave", "WrappedWaveWarning", "angular_spectrum", "split_step", "validity"]
