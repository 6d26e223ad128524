"""Read the flow files of any CFD program, or list what they contain."""

from .contents import Contents, contents
from .dataset import ReadError
from .frame import Frame
from .read import read
from .reader import Reader
from .volumes.measuring_lines import VolumeResampling
from .volumes.resampling import Resampling

__all__ = ["Contents", "Frame", "ReadError", "Reader", "Resampling", "VolumeResampling", "contents", "read"]
