"""Shadowgraphs: the light on a screen behind the field, or on the plane that a camera is focused on.

Four neighbouring rays carry the light of the square between them, which is spread evenly over the quadrilateral onto
which they map that square: light is conserved, also where rays have crossed. Diffraction is neglected. Reference: G. S.
Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), chapter 6.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..display.shown import shown
from ..inputs.arguments import checked
from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.pupil.air import GREATEST_SHARE
from .bench import Bench, blurred, check_source
from .line_of_sight import LineOfSight, Window, check_exposure, ray_lines, traced_light
from .picture import TracedPicture
from .picture_error import SPREAD, SomeLight, light_on_squares, shared_attributes


@shown
@dataclass(frozen=True, eq=False, kw_only=True)
class Shadowgraph(TracedPicture):
    """A shadowgraph with the data that it was made from; none of the rays that begin or land at a known pixel fails.

    Attributes:
        irradiance: light on the screen, 1 where there is no field, shape (ny, nx).
        distance: from the field's middle to the screen, along the light [m].
        source_angle: full angle that the source subtends [rad].
        source: the source's shape, as in a `Bench`.
    """

    irradiance: np.ndarray
    distance: float
    source_angle: float
    source: str | Pupil = "disc"

    KIND: ClassVar[str] = "shadowgraph"
    MAPS: ClassVar[dict[str, tuple[str, str, str]]] = {
        "irradiance": ("pixel", "1", "light on the screen over undisturbed light")
    }
    NUMBERS: ClassVar[dict[str, str]] = {
        "distance_m": "distance",
        "source_angle_rad": "source_angle",
        "source": "source",
    }


@checked
def shadowgraph(
    field: IndexField | LineOfSight,
    *,
    distance: float,
    source_angle: float = 0.0,
    exposure: float = 0.5,
    bench: Bench | None = None,
    **options: Any,
) -> Shadowgraph:
    """Make a shadowgraph of a field.

    Args:
        field: any field, of which a planar one needs `width` and a view along x; or light that was traced through one.
        distance: from the field's middle to the screen, along the light [m]. A camera may be focused on a plane inside
            the field or in front of it: then this is small or negative, and the rays are extended straight back.
        source_angle: full angle that the source, a disc, subtends as seen from the field [rad]: it blurs by distance
            times angle.
        exposure: brightness of undisturbed light, 1 for white.
        bench: the bench's optics: its source gives the angle and the shape of the blur (a slit blurs along the
            horizontal only), its sensor the noise; the screen is in focus.
        **options: view, extent, pixel_count, rays_per_pixel, width, tolerance, wavelength, backend, device, precision:
            as in `line_of_sight`.

    Raises:
        ValueError: an argument is out of range; the message names it and the remedy.
    """
    screen = Screen(distance, source_angle)
    check_exposure(exposure)
    if bench is not None:
        if source_angle:
            raise ValueError(f"source_angle = {source_angle}: the bench's source gives it; leave it out")
        screen = Screen(distance, bench.angle, bench.source)
    traced = traced_light(field, options)
    if min(traced.through.shape) < 2:
        raise ValueError(f"a shadowgraph needs at least 2 x 2 rays, got {traced.through.shape}: raise pixel_count")
    irradiance, known = screen.light(traced), traced.known
    if traced.doubtful.any():
        known = known & (screen.light(traced, traced.doubtful.astype(np.float64)) <= GREATEST_SHARE)
    square = max(*traced.window.pitch, abs(screen.distance) * screen.source_angle)
    return Shadowgraph(
        irradiance=irradiance,
        distance=float(screen.distance),
        source_angle=float(screen.source_angle),
        source=screen.source,
        **shared_attributes(
            screen, traced, irradiance, exposure, bench=bench, known=known, square=square, curved=SPREAD
        ),
    )


@dataclass(frozen=True)
class Screen:
    """A screen and the source whose light falls on it: the arguments of `shadowgraph` of the same names."""

    distance: float
    source_angle: float = 0.0
    source: str | Pupil = "disc"

    def __post_init__(self) -> None:
        """Check the values."""
        if not np.isfinite(self.distance):
            raise ValueError(
                f"distance = {self.distance}: give the position of the screen in metres from the field's middle"
            )
        if not 0.0 <= self.source_angle < 0.5:
            raise ValueError(f"source_angle = {self.source_angle}: give an angle in radians, 0 for a point source")
        check_source(self.source)

    def landing(self, traced: LineOfSight | SomeLight) -> np.ndarray:
        """Return the displacement of the rays on the screen [m]: they go straight on from the focal plane."""
        sine = traced.deflection
        tangent = sine / np.sqrt(1.0 - np.sum(sine**2, axis=-1, keepdims=True))
        return np.asarray(traced.displacement + (self.distance - (traced.focus - traced.window.middle)) * tangent)

    def light(self, traced: LineOfSight, share: np.ndarray | None = None) -> np.ndarray:
        """Return the irradiance of the pixels, blurred by the source; `share` as in `spread`."""
        sharp, width = spread(traced, self.landing(traced), share), self.distance * self.source_angle
        return blurred(sharp, self.source, width, traced.window.pitch) if self.source_angle > 0.0 else sharp

    def light_of(self, some: SomeLight) -> np.ndarray:
        """Return the light of some pixels, shape (pixels,)."""
        return light_on_squares(some, self.landing(some))


def spread(traced: LineOfSight, shift: np.ndarray, share: np.ndarray | None = None) -> np.ndarray:
    """Return the irradiance of the pixels, 1 where nothing is shifted, shape (ny, nx).

    `shift` displaces each ray's landing point [m], shape (ny k, nx k, 2), NaN if it does not land; `share` of its light
    is transmitted, None for all.
    """
    undisturbed, border = _with_border(traced, shift)
    if share is not None:
        edge = (len(border) - len(shift)) // 2
        share = np.pad(share, edge, mode="edge")
        share = 0.25 * (share[:-1, :-1] + share[:-1, 1:] + share[1:, :-1] + share[1:, 1:])
    return _spread(undisturbed, border, traced.window, share) / traced.rays_per_pixel**2


def _with_border(traced: LineOfSight, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and shifts of the rays [m], with extra rays around them that shift like the outermost."""
    k, window = traced.rays_per_pixel, traced.window
    greatest = np.nan_to_num(np.abs(shift), nan=0.0).max(axis=(0, 1)) / np.asarray(window.pitch)
    border = k * int(min(2.0 + np.ceil(greatest.max()), 100.0))
    lines = []
    for line, pitch in zip(ray_lines(window, k), window.pitch, strict=True):
        outside = pitch / k * np.arange(1, border + 1)
        lines.append(np.concatenate([line[0] - outside[::-1], line, line[-1] + outside]))
    undisturbed = np.stack(np.meshgrid(*lines), axis=-1)
    return undisturbed, np.pad(shift, ((border, border), (border, border), (0, 0)), mode="edge")


def _spread(undisturbed: np.ndarray, shift: np.ndarray, window: Window, share: np.ndarray | None = None) -> np.ndarray:
    """Return the light in each pixel, shape (ny, nx), from the squares between rays, in units of one square.

    `rest` has the undisturbed positions (right, up) of the rays [m], shape (rows, columns, 2), `shift` the displacement
    of their landing points, NaN for rays that do not land; `share` is that of each square's light that counts.
    """
    landing = undisturbed + shift
    first = np.array([window.horizontal[0], window.vertical[0]])
    place = (landing - first) / np.asarray(window.pitch)
    corners = np.stack([place[:-1, :-1], place[:-1, 1:], place[1:, :-1], place[1:, 1:]], axis=2).reshape(-1, 4, 2)
    there = np.isfinite(corners).all(axis=(1, 2))
    corners = corners[there]
    amount = np.ones(len(corners)) if share is None else share.ravel()[there]
    # Rounded up to powers of two, so that there are few sizes to process.
    size = np.ptp(corners, axis=1).max(axis=1)
    parts = np.exp2(np.ceil(np.log2(np.clip(3.0 * size, 1.0, 64.0)))).astype(int)
    shape = (len(window.vertical), len(window.horizontal))
    light = np.zeros(shape[0] * shape[1])
    for count in np.unique(parts):
        share = (np.arange(count) + 0.5) / count
        u, v = (grid.ravel() for grid in np.meshgrid(share, share))
        weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
        chosen, of_each = corners[parts == count], amount[parts == count]
        rightward, upward = chosen[:, [1, 3]] - chosen[:, [0, 2]], chosen[:, 2:] - chosen[:, :2]
        sides = np.maximum(np.abs(rightward.mean(axis=1)), np.abs(upward.mean(axis=1)))
        sides = np.repeat(sides[:, None] / count, count**2, axis=1)
        block = max(1, 2_000_000 // count**2)  # limits the memory
        for start in range(0, len(chosen), block):
            part = slice(start, start + block)
            middle = np.einsum("qcd,cp->qpd", chosen[part], weights).reshape(-1, 2)
            each = np.repeat(of_each[part] / count**2, count**2)
            _deposit(middle, sides[part].reshape(-1, 2), each, light, shape)
    return light.reshape(shape)


def _deposit(
    middle: np.ndarray, size: np.ndarray, amount: np.ndarray, light: np.ndarray, shape: tuple[int, int]
) -> None:
    """Add the amount of each rectangle, about `middle` (column, row) [pixels], evenly to the pixels of `light`."""
    size = np.clip(size, 1e-9, 1.0)
    low = np.floor(middle - 0.5 * size + 0.5)  # pixel in which the rectangle begins
    first = np.clip((low + 0.5 - (middle - 0.5 * size)) / size, 0.0, 1.0)  # share in that pixel
    column, row = low.astype(np.int64).T
    for d_row in (0, 1):
        for d_column in (0, 1):
            i, j = row + d_row, column + d_column
            inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
            across = 1.0 - first[:, 0] if d_column else first[:, 0]
            along = 1.0 - first[:, 1] if d_row else first[:, 1]
            weight = (amount * across * along)[inside]
            light += np.bincount((i * shape[1] + j)[inside], weights=weight, minlength=light.size)
