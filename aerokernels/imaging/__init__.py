"""Pictures through a flow: what a camera sees of an extended scene, and the bench of background-oriented schlieren."""

from .bos import BackgroundPictures, bos
from .camera import Camera
from .dots import DotPattern
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
