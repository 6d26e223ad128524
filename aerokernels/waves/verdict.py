"""Data class of the verdict on ray optics; validity.py computes it."""

from dataclasses import dataclass

import numpy as np

from ..display.quantities import Quantity

# Default limit: the greatest change of the Strehl ratio for which rays are good.
GOOD = 1e-2
# Fewest pixels across a map from which the finest phase is known.
FEWEST_MAPPED = 32


@dataclass(frozen=True)
class Validity:
    """Verdict on ray optics: the effect of diffraction, which rays ignore.

    Attributes:
        strehl_change: Strehl ratio of the wave minus the one of rays, both through the same samples.
        feature: Half period of the finest relevant phase [m]; infinite if there is none.
        distance: Length over which the light is disturbed [m].
        fresnel_number: feature^2 / (wavelength distance).
        crossed_share: Share of the pupil where rays cross.
        curvature: Greatest product of that distance and a focusing curvature of the wavefront.
        limit: The change of the Strehl ratio up to which rays are good.
        answered_by: "rays" if the traced wavefront decided, "bounds" if bounds of the field's derivatives did, "waves"
            if a wave was propagated through the field, "nobody" if it is not decided: then the numbers are NaN.
        blocked: Share of the pupil's light that ends on the field's body; it is excluded from both Strehl ratios.
        rim_fresnel_number: Fresnel number of the light that passes the body's rim, up to the end of the box: below some
            tens the fringes of the rim extend over all of it. Infinite if no body is near.
        bound: Upper bound of the change if bounds were evaluated, else infinite. If they decide, `strehl_change` is 0
            with this error, and the finest phase is not known.
        error: Error of the change found by a wave, measured with half as many slabs; infinite if rays come near foci
            and no traced rays are available; NaN if not known.
    """

    strehl_change: float = float("nan")
    feature: float = float("nan")
    distance: float = float("nan")
    fresnel_number: float = float("nan")
    crossed_share: float = float("nan")
    curvature: float = float("nan")
    limit: float = GOOD
    answered_by: str = "waves"
    blocked: float = 0.0
    rim_fresnel_number: float = float("inf")
    bound: float = float("inf")
    error: float = float("nan")

    @property
    def good(self) -> bool:
        """Whether rays are known to give the Strehl ratio to within `limit`; False if not decided."""
        return abs(self.strehl_change) <= self.limit

    @property
    def decided(self) -> bool:
        """Whether the verdict is decided."""
        return self.answered_by != "nobody"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        if not self.decided:
            return (
                "not decided: the traced wavefront alone is not conclusive, bounds of the field's derivatives allow a "
                f"change of the Strehl ratio by {self.bound:.2g} (limit {self.limit:g}), and a wave would be expensive "
                "compared with this wavefront; request one by validity(..., waves=True), or trace a map of "
                f"{FEWEST_MAPPED} pixels across or more"
            )
        if self.answered_by == "bounds":
            return (
                f"rays are good: diffraction changes the Strehl ratio by at most {self.bound:.2g} (limit "
                f"{self.limit:g}), according to bounds of the field's derivatives"
            )
        source = "the traced wavefront" if self.answered_by == "rays" else "a wave through the field"
        size = Quantity(self.strehl_change, self.error if np.isfinite(self.error) else None).text(signed=True)
        change = f"diffraction changes the Strehl ratio by {size} (limit {self.limit:g})"
        change += f", according to {source}"
        if np.isfinite(self.rim_fresnel_number):
            change += (
                f"; {100.0 * self.blocked:.2g} % of the light ends on the body, and the rest diffracts at its rim with "
                f"a Fresnel number of {self.rim_fresnel_number:.2g}"
            )
        if self.good:
            return f"rays are good: {change}"
        why = f"the Fresnel number of the finest phase is {self.fresnel_number:.2g}"
        if self.crossed_share > 0.0:
            why = f"rays cross over {100.0 * self.crossed_share:.2g} % of the pupil"
        return f"rays are not good: {change}; {why}; see split_step"

    def __bool__(self) -> bool:
        """Whether rays are good."""
        return self.good
