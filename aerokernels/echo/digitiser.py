"""Model the digitiser, which clips voltages to its range and rounds them to its codes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import as_finite_array, check_at_least, check_count

if TYPE_CHECKING:
    from ..scene import Scene

GREATEST_BIT_COUNT = 24


@checked
@dataclass(frozen=True)
class Digitiser:
    """An analogue-to-digital converter.

    Attributes:
        bit_count: Number of bits, 1 to 24.
        low: Voltage of the lowest code [V].
        high: Voltage of the highest code [V].

    Raises:
        ValueError: A number of bits out of range, or a `low` that is not below `high`.
    """

    bit_count: int
    low: float = -0.5
    high: float = 4.5

    def __post_init__(self):
        """Check the number of bits and the range."""
        object.__setattr__(self, "bit_count", check_count(self.bit_count, "bit_count", 1, GREATEST_BIT_COUNT))
        if check_at_least(self.low, "low") >= check_at_least(self.high, "high"):
            raise ValueError(f"the digitiser's low {self.low:g} V must be below its high {self.high:g} V")

    @property
    def step(self) -> float:
        """Voltage between two codes [V]."""
        return (self.high - self.low) / (2**self.bit_count - 1)

    @checked
    def codes(self, voltage: Numbers) -> np.ndarray:
        """Return the nearest codes, 0 to 2^bit_count - 1, of voltages [V], clipped to the digitiser's range."""
        volts = np.clip(as_finite_array(voltage, "voltage"), self.low, self.high)
        return np.rint((volts - self.low) / self.step).astype(np.int64)

    @checked
    def record(self, voltage: Numbers) -> np.ndarray:
        """Return voltages [V] rounded to those of the nearest codes."""
        return self.low + self.step * self.codes(voltage)


def digitiser_of(scene: "Scene") -> Digitiser | None:
    """Return the digitiser of a scene; None if the scene sets no number of bits."""
    table = scene.detector
    return None if table.bit_count is None else Digitiser(table.bit_count, table.adc_low, table.adc_high)
