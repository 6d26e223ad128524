"""Read the flow files of any CFD program, or list what they contain."""

from .contents import Contents, contents
from .dataset import ReadError
from .frame import Frame
from .measuring_lines import VolumeResampling
from .read import read
from .reader import Reader
from .resampling import Resampling

__all__ = ["Contents", "Frame", "ReadError", "Reader", "Resampling", "VolumeResampling", "contents", "read"]
