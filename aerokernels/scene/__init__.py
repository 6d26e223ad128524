"""What a user describes: TOML to checked objects, SI inside."""

from .errors import SceneError
from .loading import shipped_scenes
from .scene import Scene
from .tables import STATIC_CALIBRATION

__all__ = ["STATIC_CALIBRATION", "Scene", "SceneError", "shipped_scenes"]
