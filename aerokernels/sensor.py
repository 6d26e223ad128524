"""Simulate a camera's sensor: electrons with shot noise, read noise, saturation and grey levels.

Brightness 1 fills a pixel to `exposure` of its full well. The electrons are Poisson distributed about that number,
readout adds Gaussian noise, and the sum is limited to the full well and rounded to 2^bits - 1 levels.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_at_least, check_count, check_positive


@checked
@dataclass(frozen=True)
class Sensor:
    """A camera's sensor.

    Attributes:
        full_well: Greatest number of electrons in a pixel.
        exposure: Fraction of the full well that brightness 1 fills.
        read_noise: Noise of the readout [electrons rms].
        dark: Electrons of dark current in the exposure time.
        bits: Bits of a grey level, 1 to 16.
        shot_noise: Whether electrons are Poisson distributed; without shot and read noise only levels are rounded.

    Raises:
        ValueError: A number that makes no sense.
    """

    full_well: float = 10_000.0
    exposure: float = 0.8
    read_noise: float = 2.5
    dark: float = 0.0
    bits: int = 12
    shot_noise: bool = True

    def __post_init__(self):
        """Check the numbers."""
        for name in ("full_well", "exposure"):
            check_positive(getattr(self, name), name)
        for name in ("read_noise", "dark"):
            check_at_least(getattr(self, name), name, 0.0)
        check_count(self.bits, "bits", 1, 16)

    @property
    def levels(self) -> int:
        """The greatest grey level."""
        return 2 ** int(self.bits) - 1

    @checked
    def expose(self, brightness: Numbers, seed: int = 0) -> np.ndarray:
        """Return grey levels relative to the greatest one, 0 to 1, of a picture's shape.

        Args:
            brightness: Brightness, 1 filling the share `exposure` of the full well, any shape. Negative values, and
                NaN, which marks light that is not known, count as dark.
            seed: Seed of the noise.
        """
        brightness = np.maximum(np.nan_to_num(np.asarray(brightness, dtype=np.float64)), 0.0)
        electrons = self.full_well * self.exposure * brightness + self.dark
        draw = np.random.default_rng(seed)
        if self.shot_noise:
            electrons = np.asarray(draw.poisson(np.minimum(electrons, 1e15)), dtype=np.float64)
        if self.read_noise > 0.0:
            electrons = electrons + self.read_noise * draw.standard_normal(electrons.shape)
        return np.asarray(np.rint(np.clip(electrons / self.full_well, 0.0, 1.0) * self.levels) / self.levels)
