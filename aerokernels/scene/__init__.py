"""What a user describes: TOML to checked objects, SI inside."""

from aerokernels.scene.echo_tables import STATIC_CALIBRATION
from aerokernels.scene.loading import SceneError, shipped_scenes
from aerokernels.scene.scene import Scene, warn_of_unused

__all__ = ["STATIC_CALIBRATION", "Scene", "SceneError", "shipped_scenes", "warn_of_unused"]
