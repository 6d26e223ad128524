"""Read the flow files of any CFD program, or list what they contain.

Every module refuses a file that cannot be used by `ReadError`: file, place and remedy, in one sentence.
"""

from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.formats import Contents, contents
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.read import Reader, read
from aerokernels.flow.reading.volumes.reconstruction import VolumeResampling
from aerokernels.flow.reading.volumes.resampling import Resampling

__all__ = ["Contents", "Frame", "ReadError", "Reader", "Resampling", "VolumeResampling", "contents", "read"]
