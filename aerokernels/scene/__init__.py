"""What a user describes: TOML to checked objects, SI inside."""

from aerokernels.scene.changes import warn_of_unused
from aerokernels.scene.echo_tables import STATIC_CALIBRATION
from aerokernels.scene.errors import SceneError
from aerokernels.scene.loading import shipped_scenes
from aerokernels.scene.scene import Scene

__all__ = ["STATIC_CALIBRATION", "Scene", "SceneError", "shipped_scenes", "warn_of_unused"]
