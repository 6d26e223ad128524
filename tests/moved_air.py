"""Two unlike lumps of air in a box of 16 x 20 x 24 cells that can be moved, mirrored and have its axes exchanged."""

import numpy as np

from aerokernels import IndexField

PITCH = 2.0**-10  # [m]; a power of two: moving by whole cells rounds nothing


def lumps(move=(0.0, 0.0, 0.0), turned: bool = False, mirrored=(), interpolation: str = "cubic") -> IndexField:
    """The lumps; turned: x and y exchanged; mirrored: along these axes, about the middle of the unmoved box."""
    shape = (17, 21, 25)
    place = [PITCH * (np.arange(count) - count // 2) for count in shape]
    x, y, z = np.meshgrid(*place, indexing="ij")
    contrast = 2e-6 * np.exp(-((x - 2e-3) ** 2 + (y - 4e-3) ** 2 + z**2) / 4e-3**2)
    contrast += 1e-6 * np.exp(-((x + 3e-3) ** 2 + (y + 1e-3) ** 2 + (z - 5e-3) ** 2) / 3e-3**2)
    contrast = np.flip(contrast, mirrored)
    origin = [float(axis[0]) for axis in place]
    if turned:
        contrast, origin = np.ascontiguousarray(contrast.swapaxes(0, 1)), [origin[1], origin[0], origin[2]]
    return IndexField.from_samples(
        np.ascontiguousarray(contrast), origin=[start + step for start, step in zip(origin, move, strict=True)],
        spacing=(PITCH,) * 3, geometry="volume", interpolation=interpolation,
    )  # fmt: skip


BOX = PITCH * np.array([8.0, 10.0, 12.0])  # half of it [m]


class Moved:
    """A change of the whole arrangement: what it does to the field, to places and to directions."""

    def __init__(self, move=(0.0, 0.0, 0.0), turned: bool = False, mirrored=()):
        self.move, self.turned, self.mirrored = np.array(move), turned, mirrored

    def field(self, interpolation: str = "cubic") -> IndexField:
        return lumps(self.move, self.turned, self.mirrored, interpolation)

    def way(self, vector) -> np.ndarray:
        found = np.array(vector, dtype=float)
        for axis in self.mirrored:
            found[..., axis] *= -1.0
        return found[..., [1, 0, 2]] if self.turned else found

    def place(self, point) -> np.ndarray:
        return self.way(point) + self.move

    def table(self, values: np.ndarray) -> np.ndarray:
        found = np.flip(values, self.mirrored)
        return found.swapaxes(0, 1) if self.turned else found


PLAIN = Moved()
CHANGES = {
    "moved": Moved(PITCH * np.array([5.0, -7.0, 3.0])),
    "turned": Moved(turned=True),
    "mirrored in x": Moved(mirrored=(0,)),
    "mirrored in y": Moved(mirrored=(1,)),
    "turned about x": Moved(mirrored=(1, 2)),
}


def some_rays(count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """From all around the box, from within it, and past it."""
    rng = np.random.default_rng(3)
    position = 1.6 * BOX * rng.uniform(-1.0, 1.0, (count, 3))
    direction = 0.7 * BOX * rng.uniform(-1.0, 1.0, (count, 3)) - 0.6 * position
    return position, direction / np.linalg.norm(direction, axis=1)[:, None]


def beams(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Along z, from before the box, a little aslant."""
    rng = np.random.default_rng(4)
    position = np.c_[PITCH * rng.uniform(-5.0, 5.0, (count, 2)), np.full(count, -15.0 * PITCH)]
    direction = np.c_[rng.uniform(-0.1, 0.1, (count, 2)), np.ones(count)]
    return position, direction / np.linalg.norm(direction, axis=1)[:, None]


def same(found, expected) -> None:
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    finite = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(found), finite)
    scale = np.abs(expected[finite]).max(initial=0.0)
    np.testing.assert_allclose(found[finite], expected[finite], atol=1e-9 * scale, rtol=1e-9)
