"""A picture with its scale, synthetic or from a photograph, and its datasets."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..inputs.arguments import checked
from .view import PictureView

if TYPE_CHECKING:
    import xarray


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Picture(PictureView):
    """A picture with its scale.

    Attributes:
        intensity: brightness, 0 black to 1 white, rows from the lowest up, shape (ny, nx).
        horizontal: pixel centres along the horizontal [m], even and increasing, shape (nx,).
        vertical: pixel centres along the vertical [m], even and increasing, shape (ny,).

    Raises:
        ValueError: shapes disagree, numbers are not finite, or centres do not increase evenly.
    """

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray

    def __post_init__(self) -> None:
        """Check the values."""
        intensity = np.array(self.intensity, dtype=np.float64)
        if intensity.ndim != 2 or not np.isfinite(intensity).all():
            raise ValueError(f"a picture must be a two-axis array of finite brightness, got shape {intensity.shape}")
        object.__setattr__(self, "intensity", intensity)
        for name, count in (("horizontal", intensity.shape[1]), ("vertical", intensity.shape[0])):
            centres = np.array(getattr(self, name), dtype=np.float64)
            if centres.shape != (count,):
                raise ValueError(
                    f"{name} has shape {centres.shape}, the picture {intensity.shape}: give one centre for each pixel"
                )
            steps = np.diff(centres)
            if not np.isfinite(centres).all() or (steps <= 0.0).any() or np.ptp(steps) > 1e-6 * steps.max(initial=0.0):
                raise ValueError(f"{name}: the pixel centres must increase in even steps")
            object.__setattr__(self, name, centres)


def picture_dataset(
    picture: PictureView, extra: dict[str, tuple[str, np.ndarray, str, str]], attributes: dict[str, object]
) -> "xarray.Dataset":
    """Return a picture as a dataset: `intensity` over vertical and horizontal, and further arrays.

    Args:
        picture: the picture.
        extra: further arrays by name: dimensions ("pixel" for one value a pixel, "pixel direction" for a pair), array,
            unit, meaning.
        attributes: attributes of the dataset.
    """
    import xarray

    dims = {"pixel": ("vertical", "horizontal"), "pixel direction": ("vertical", "horizontal", "direction")}
    variables = {
        "intensity": (dims["pixel"], picture.intensity, {"units": "1", "long_name": "brightness, 1 is white"}),
        **{
            name: (dims[kind], array, {"units": unit, "long_name": words})
            for name, (kind, array, unit, words) in extra.items()
        },
    }
    coordinates = {
        "horizontal": ("horizontal", picture.horizontal, {"units": "m", "long_name": "along the picture's horizontal"}),
        "vertical": ("vertical", picture.vertical, {"units": "m", "long_name": "along the picture's vertical"}),
    }
    if any(kind == "pixel direction" for kind, *_ in extra.values()):
        coordinates["direction"] = ("direction", np.array(["right", "up"]), {"units": "1", "long_name": "component"})
    return xarray.Dataset(variables, coordinates, attributes)


def traced_dataset(
    picture: Any, extra: dict[str, tuple[str, np.ndarray, str, str]], attributes: dict[str, object]
) -> "xarray.Dataset":
    """Return `picture_dataset` of a traced picture, with its marked pixels, exposure and axes."""
    blocked = ("pixel", picture.blocked.astype(np.int8), "1", "1 where the body hides the light")
    marks = {"blocked": blocked}
    if picture.known is not None:
        marks["known"] = ("pixel", picture.known.astype(np.int8), "1", "0 where the light is not known")
    own = {"exposure": picture.exposure, "right": picture.right, "up": picture.up}
    return picture_dataset(picture, {**extra, **marks}, {**attributes, **own})
