"""What a user describes: TOML to checked objects, SI inside."""

from .detector_table import STATIC_CALIBRATION
from .errors import SceneError
from .loading import shipped_scenes
from .scene import Scene
from .unused import warn_of_unused

__all__ = ["STATIC_CALIBRATION", "Scene", "SceneError", "shipped_scenes", "warn_of_unused"]
