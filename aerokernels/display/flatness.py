"""What is below rounding gets no card, no colours and no axes: it is said in words.

Differences of an optical path below a picometre, of angles below a tenth of a nanoradian (a picometre across a pupil
of 10 mm) and of ratios below a millionth are of rounding: float32 rounds the path of a ray through 10 cm of sea-level
air to two picometres. So are differences below a thousandth of their own error, whatever they are of.
"""

from typing import Any

import numpy as np

from .quantities import Quantity

# Greatest number of a unit that counts as rounding; and the greatest share of an error.
ROUNDING = {"m": 1e-12, "rad": 1e-10, "1": 1e-6, "pixel": 1e-5}
SHARE_OF_ERROR = 1e-3
# Greatest spread of other values that counts as rounding, over the greatest of them.
RELATIVE = 1e-9
# The units in which numbers are printed, and the SI units that they have.
SI = {"nm": "m", "mm": "m", "µrad": "rad"}
NOTHING = "0, error below rounding"


def is_flat(values: Any, unit: str | None = None, error: float = float("nan")) -> bool:
    """Return whether the differences between values are below rounding; so are those of no finite values.

    Args:
        values: Numbers of any shape; NaN where there is none.
        unit: "m" for optical paths, "rad" for angles, "1" for ratios, "pixel" for displacements; any other value, also
            None, for values whose rounding is a share of themselves.
        error: Greatest error of the values; NaN if it is not known.
    """
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return True
    least = ROUNDING.get(unit or "", RELATIVE * float(np.abs(finite).max()))
    return float(np.ptp(finite)) <= max(least, SHARE_OF_ERROR * (error if np.isfinite(error) else 0.0))


def told(number: Quantity, factor: float, unit: str, signed: bool = False) -> str:
    """Return a quantity in another unit as text, NOTHING where it is 0 but for rounding and its error is small too."""
    least = ROUNDING.get(SI.get(unit, unit) if unit else "", -1.0)
    if abs(number.value) <= least and not (number.error or 0.0) > least / SHARE_OF_ERROR:
        return NOTHING
    return number.scaled(factor, unit).text(signed)


def say_flat(axes: Any, words: str = "flat: its differences are below rounding", bar: Any = None) -> None:
    """Write words in Matplotlib axes in place of what they would draw, and hide ticks, labels and the colour bar."""
    if bar is not None:
        bar.set_visible(False)
    axes.set_axis_off()
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", wrap=True)
