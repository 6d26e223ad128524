"""Render a picture of an extended scene through a flow.

    picture(p) = sum over nodes of h(p) (K * scene)(p + shift(p) - shift(node)),     K centred on shift(node)

with hat functions h between the nodes. A constant shift is in the kernels alone, which the Fourier transform shifts
exactly; only its variation is interpolated. Radiance is conserved: nothing brightens where the flow magnifies.
"""

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ..display.shown import drawn_on
from ..files.writing import write_grey
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_count, check_spectrum
from ..inputs.kinds import refuse_masked
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..sensor import Sensor
from ..tracing.plan import TraceOptions
from .camera import Camera
from .render import render
from .shift import APERTURE_RAYS, BackgroundDisplacement, gather, view_options
from .spreads import PupilSamples, SpreadGrid, defocus_paths, spread_grid

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

# Defaults: nodes along a side, pixels across a point spread function, rays across the pupil.
NODE_COUNT, SIZE, PUPIL_PIXELS = 9, 32, 32


@dataclass(frozen=True, eq=False, repr=False)
class ImageThrough:
    """A scene seen through a flow.

    Attributes:
        image: Brightness through the flow, shape (rows, columns), axes [y, x], rows from the lowest up; a third axis
            of colours where the scene has one.
        scene: The scene.
        shift: Displacement of each pixel, with its blur and errors.
        spreads: Point spread functions at nodes over the picture.
        camera: The camera.
        wavelength: Vacuum wavelength [m] of the trace.
        spectrum: The vacuum wavelengths of the picture's light [m] and their weights, each of shape (n,).
        ambient_index: Index of the undisturbed medium, in which the camera is.
        seconds: Wall time by stage: see STAGES in clock.py.
    """

    image: np.ndarray
    scene: np.ndarray
    shift: BackgroundDisplacement
    spreads: SpreadGrid
    camera: Camera
    wavelength: float
    spectrum: tuple[np.ndarray, np.ndarray]
    ambient_index: float = 1.0
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of the picture's content, along x and y [pixels], shape (rows, columns, 2)."""
        return self.shift.displacement

    @cached_property
    def reference(self) -> np.ndarray:
        """Picture of the same camera without the flow, of the shape of `image`."""
        shape, size = self.image.shape[:2], self.spreads.kernel.shape[-1]
        pupil = PupilSamples(self.camera, PUPIL_PIXELS)
        zero, middle, kernel = np.zeros((1, 2)), np.array([0]), np.zeros((1, size, size))
        opd = defocus_paths(self.camera, zero, pupil.points)
        for length, weight in zip(*self.spectrum, strict=True):
            kernel += weight * pupil.spreads(opd, 1.0, zero, zero, float(length / self.ambient_index), size)[0]
        grid = SpreadGrid(middle, middle, kernel[None], np.zeros((1, 1, 2), dtype=int), np.ones((1, 1)))
        return render(self.scene, grid, np.zeros((*shape, 2)), np.ones(shape))

    @property
    def known(self) -> np.ndarray:
        """Mask of the pixels that look through air that is all in the field: see BackgroundDisplacement."""
        return self.shift.known

    def write(self, path: str | Path) -> None:
        """Write a grey picture in 16 bits, TIFF or PNG, the uppermost row first."""
        write_grey(path, self.image)

    def to_xarray(self) -> "xarray.Dataset":
        """Return picture, displacement and blur as a dataset with units."""
        dims = ("y", "x", "colour")[: self.image.ndim]
        words = {"units": "1", "long_name": "brightness through the flow"}
        light = ("wavelength", self.spectrum[1], {"units": "1", "long_name": "share of the light"})
        length = ("wavelength", self.spectrum[0], {"units": "m", "standard_name": "radiation_wavelength"})
        dataset = self.shift.to_xarray().assign(image=(dims, self.image, words), weight=light)
        return dataset.assign_coords(wavelength=length)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the picture on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        axes.imshow(self.image, origin="lower", cmap="gray")
        axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
        return axes

    def __repr__(self) -> str:
        """Size, displacement and point spread functions."""
        rows, columns = self.image.shape[:2]
        m, n, size, _ = self.spreads.kernel.shape
        return (
            f"ImageThrough of {rows} x {columns} pixels, {m} x {n} point spread functions of {size} pixels that hold "
            f"{100.0 * float(self.spreads.kept.min()):.4g} % of the light or more; {self.shift!r}"
        )


@checked
def image_through(
    field: IndexField,
    scene_image,
    camera: Camera,
    *,
    psf_nodes: int = NODE_COUNT,
    psf_pixels: int = SIZE,
    pupil_pixels: int = PUPIL_PIXELS,
    aperture_rays: int = APERTURE_RAYS,
    sensor: Sensor | None = None,
    seed: int = 0,
    wavelengths: Numbers | None = None,
    weights: Numbers | None = None,
    wavelength: float | None = None,
    **options: Unpack[TraceOptions],
) -> ImageThrough:
    """Render an extended scene through a flow: displaced by the shift map, blurred by point spread functions.

    A flow of constant OPD gradient a along x turns light that leaves the camera by +a, so the scene appears displaced
    by -a: see docs/conventions.md.

    Args:
        field: The refractive index.
        scene_image: Brightness that the camera's pixels would see of the scene with a perfect lens, shape (rows,
            columns) or (rows, columns, colours), axes [y, x], rows from the lowest up. It may be larger than the
            picture by an even number of pixels; its border is continued outside.
        camera: The camera.
        psf_nodes: Number of point spread functions along a side of the picture.
        psf_pixels: Side of a point spread function [pixels].
        pupil_pixels: Rays across the pupil for each of them.
        aperture_rays: Approximate number of points of the aperture for the mean shift.
        sensor: Adds noise and grey levels; None leaves the brightness as it is.
        seed: Seed of the noise.
        wavelengths: Vacuum wavelengths of the light [m], shape (n,), with one OPD: dispersion of air is ignored. None
            takes the wavelength of the trace.
        weights: Shares of the light's energy at those wavelengths, shape (n,), of any sum. None: equal shares.
        wavelength: As in `background_displacement`.
        options: As in `background_displacement`.

    Raises:
        TypeError: An argument is of the wrong type, or an option is unknown.
        ValueError: A number is out of range, the scene's shape does not fit, no ray meets the field, or the view is
            truncated and `allow_truncation` is not set.

    Warns:
        RuntimeWarning: More than a fifth of the light of a point spread function is outside of its `psf_pixels`, as far
            out of focus: `spreads.kept` has the shares.
    """
    whole = view_options(field, camera, wavelength, options, sensor)
    check_count(psf_nodes, "psf_nodes")
    check_count(psf_pixels, "psf_pixels")
    check_count(pupil_pixels, "pupil_pixels", 2)
    scene = _brightness(scene_image)
    shape = camera.shape(scene)
    if any(n < m or (n - m) % 2 for n, m in zip(scene.shape, shape, strict=False)):
        raise ValueError(
            f"the scene has {scene.shape[0]} x {scene.shape[1]} pixels, the picture {shape[0]} x {shape[1]}: the scene "
            "must be as large, or larger by an even number"
        )
    spectrum = None if wavelengths is None and weights is None else check_spectrum(wavelengths, weights)
    if spectrum is not None and field.wavelength is None and wavelength is None:
        whole["wavelength"] = float(spectrum[0].min())
    with clocked() as seconds:
        found = gather(field, camera, shape, aperture_rays, whole)
        spectrum = check_spectrum(found.wavelength) if spectrum is None else spectrum
        shift, dark = filled(found.shift)
        assert found.view is not None
        with stage("spread"):
            spreads = spread_grid(
                field,
                camera,
                shape,
                shift,
                node_count=int(psf_nodes),
                size=int(psf_pixels),
                pupil_pixels=pupil_pixels,
                options=found.view.options,
                spectrum=spectrum,
            )
        with stage("render"):
            image = render(scene, spreads, shift, np.where(dark, 0.0, found.through))
    if sensor is not None:
        image = sensor.expose(image, seed)
    lost = 1.0 - float(spreads.kept.min())
    if lost > 0.2:
        warnings.warn(
            f"{100.0 * lost:.3g} % of the light of a point spread function is outside of its {psf_pixels} pixels, the "
            "picture has too little blur: take more psf_pixels",
            RuntimeWarning,
            stacklevel=3,
        )
    return ImageThrough(image, scene, found, spreads, camera, found.wavelength, spectrum, field.ambient_index, seconds)


def _brightness(scene_image: Any) -> np.ndarray:
    """Return a scene as float64, shape (rows, columns) or (rows, columns, colours)."""
    refuse_masked(scene_image, "scene_image")
    given = np.asarray(scene_image)
    if given.dtype.kind not in "buif":
        raise TypeError(f"the scene must be an array of real numbers, its brightness, got {type(scene_image).__name__}")
    if given.ndim not in (2, 3) or not given.size:
        raise ValueError(f"the scene must be (rows, columns) or (rows, columns, colours), got shape {given.shape}")
    scene = given.astype(np.float64)
    if not np.isfinite(scene).all():
        bad = np.argwhere(~np.isfinite(scene))
        place = ", ".join(map(str, bad[0]))
        raise ValueError(f"the scene must be finite: {len(bad)} numbers are not, the first is at [{place}]")
    return scene


def filled(shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fill shifts where nothing is seen with those of the nearest pixel; also return a mask of where that is."""
    from scipy.ndimage import distance_transform_edt

    dark = ~np.isfinite(shift).all(axis=-1)
    if dark.all():
        return np.zeros(shift.shape), dark
    if not dark.any():
        return shift, dark
    row, column = distance_transform_edt(dark, return_distances=False, return_indices=True)
    return shift[row, column], dark
