"""Background-oriented schlieren: pictures of a dot pattern with and without a flow before it, and the displacement.

Each pixel is the mean over points of the aperture of what their rays meet of the pattern, so the lens's depth of field
and the flow's own blur are in the pictures. Correlating them (OpenPIV and its like) gives the displacement back, which
is there as traced too.

Reference: M. Raffel, Background-oriented schlieren (BOS) techniques, Exp. Fluids 56 (2015) 60.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..files.netcdf_file import write_netcdf
from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from ..medium import IndexField
from ..sensor import Sensor, write_grey
from .camera import Camera
from .dots import Background, DotPattern
from .shift import BackgroundDisplacement, check_view, gather

# Points of the aperture of a picture, and the margin of a pattern [pixels].
APERTURE_RAYS, MARGIN = 16, 32
FORMATS = ("tiff", "png")


@dataclass(frozen=True, eq=False, repr=False)
class BackgroundPictures:
    """Two pictures of a background, and how the flow displaced it.

    Attributes:
        reference: Brightness without the flow, 0 to 1, axes [y, x], rows from the lowest up.
        picture: Brightness through the flow, of the same shape.
        traced: The displacement by ray tracing.
    """

    reference: np.ndarray
    picture: np.ndarray
    traced: BackgroundDisplacement

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of the pattern along x and y [pixels], shape (rows, columns, 2); see BackgroundDisplacement."""
        return self.traced.displacement

    def write(self, folder: str | Path, format: str = "tiff") -> tuple[Path, Path]:
        """Write both pictures as 16 bits of grey, the uppermost row first, and the displacement as NetCDF beside them.

        A file's rows run downward: a correlation's displacement along its rows is minus that along y.

        Returns:
            The paths of the reference and of the picture.

        Raises:
            ValueError: Another format than "tiff" or "png".
        """
        check_choice(format, "format", FORMATS)
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        paths = folder / f"reference.{format}", folder / f"flow.{format}"
        for path, brightness in zip(paths, (self.reference, self.picture), strict=True):
            write_grey(path, brightness)
        write_netcdf(folder / "displacement.nc", self.traced.to_xarray())
        return paths

    def to_xarray(self):
        """Pictures and displacement as a dataset with units."""
        words = {"units": "1", "long_name": "brightness, 1 is white"}
        return self.traced.to_xarray().assign(
            reference=(("y", "x"), self.reference, words), picture=(("y", "x"), self.picture, words)
        )

    def plot(self, axes=None):
        """Draw the size of the displacement on matplotlib axes; returns the axes."""
        return self.traced.plot(axes)

    def __repr__(self) -> str:
        """Size and greatest displacement."""
        return repr(self.traced).replace("BackgroundDisplacement", "BackgroundPictures", 1)


@checked
def bos(
    field: IndexField,
    camera: Camera,
    pattern: DotPattern | np.ndarray | None = None,
    *,
    pattern_pixel: float | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
    aperture_rays: int = APERTURE_RAYS,
    allow_truncation: bool = False,
    **options: Any,
) -> BackgroundPictures:
    """What a bench for background-oriented schlieren records.

    Args:
        field: The refractive index.
        camera: The camera; its scene at a finite distance is where the pattern stands.
        pattern: A DotPattern, or a picture of brightness 0 to 1, axes [y, x], centred on the camera's axis.
        pattern_pixel: Side of a pixel of such a picture in the scene [m]; None: as the camera's pixels see it. Pixels
            of two thirds of the camera's and less are squares, of which a camera's pixel sees the mean; wider ones lie
            on a spline.
        sensor: Makes grey levels and noise; None: brightness as it is.
        seed: Draws the noise; that of the two pictures is independent.
        aperture_rays: Points of the aperture, about.
        allow_truncation: As for `background_displacement`.
        **options: method, tolerance [waves], wavelength, backend, device, precision, step, max_steps: as in `trace`.

    Raises:
        TypeError: An argument of the wrong kind, or an unknown option.
        ValueError: A number that makes no sense, a scene that is infinitely far, no ray that meets the field, a
            truncated view without `allow_truncation`.
    """
    check_view(field, camera, options)
    if not np.isfinite(camera.distance):
        raise ValueError("the pattern stands at the camera's distance, which is infinite: give one [m]")
    if sensor is not None and not isinstance(sensor, Sensor):
        raise TypeError(f"sensor must be a Sensor, got {type(sensor).__name__}")
    shape = camera.shape(None if isinstance(pattern, DotPattern) else pattern)
    out_of_focus = (1.0 - camera.distance / camera.focus_distance) / camera.scene_pixel
    if pattern is None or isinstance(pattern, DotPattern):
        margin = MARGIN + abs(out_of_focus) * camera.pupil.reach
        background = (pattern or DotPattern()).background(shape, margin)
    else:
        size = camera.scene_pixel if pattern_pixel is None else pattern_pixel
        background = Background.of_scene(pattern, size, camera)
    prepared = background.prepared()
    rows, columns = (np.arange(count) - 0.5 * (count - 1) for count in shape)
    reference, picture = np.zeros(shape), np.zeros(shape)

    def visit(part: slice, point: np.ndarray, weight: float, moved: np.ndarray, arrived: np.ndarray) -> None:
        row = np.broadcast_to(rows[part, None] + out_of_focus * point[1], arrived.shape)
        column = np.broadcast_to(columns + out_of_focus * point[0], arrived.shape)
        reference[part] += weight * background.seen(prepared, row, column)
        picture[part] += weight * arrived * background.seen(prepared, row + moved[..., 1], column + moved[..., 0])

    traced = gather(field, camera, shape, aperture_rays, options, visit, allow_truncation)
    if sensor is not None:
        reference, picture = sensor.expose(reference, seed=2 * seed), sensor.expose(picture, seed=2 * seed + 1)
    return BackgroundPictures(reference, picture, traced)
