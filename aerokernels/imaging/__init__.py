"""Pictures of an extended scene through a flow, and background-oriented schlieren (BOS)."""

from .bos import BackgroundPictures, DotPattern, bos
from .camera import Camera
from .shift import BackgroundDisplacement, background_displacement
from .through import ImageThrough, image_through

__all__ = [
    "BackgroundDisplacement",
    "BackgroundPictures",
    "Camera",
    "DotPattern",
    "ImageThrough",
    "background_displacement",
    "bos",
    "image_through",
]
