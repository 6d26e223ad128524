"""Wave optics beside the rays: a split-step wave through the same field, and a verdict on ray optics."""

from .angular_spectrum import angular_spectrum
from .split_step import split_step
from .validity import validity
from .verdict import Validity
from .wave import Wave

__all__ = ["Validity", "Wave", "angular_spectrum", "split_step", "validity"]
