"""What the verdict on ray optics says: see validity.py for how it is found."""

from dataclasses import dataclass

import numpy as np

# The greatest change of the Strehl ratio that rays may cost and still be good.
GOOD = 1e-2
# Pixels across a map, at least, by which the finest phase is known.
FEWEST_MAPPED = 32


@dataclass(frozen=True)
class Validity:
    """What diffraction does that rays do not know of.

    Attributes:
        strehl_change: Strehl ratio by waves less that by rays, both through the same samples.
        feature: Half period of the finest phase that matters [m]; infinite where none does.
        distance: Length over which the light is disturbed, and has left the disturbance at its end [m].
        fresnel_number: feature^2 / (wavelength distance).
        crossed_share: Share of the pupil where rays have crossed.
        curvature: The greatest product of that distance and a curvature of the wavefront, of the sign that focuses.
        limit: The change of the Strehl ratio up to which rays are good.
        answered_by: "rays" where the traced wavefront left no doubt, "bounds" where the field's own derivatives did,
            "waves" where a wave was sent through the field, "nobody" where it is not decided: then numbers are NaN.
        blocked: Share of the pupil's light that ends on the field's body: neither rays nor waves count it.
        rim_fresnel_number: Of the light that passes the body's rim, to where it leaves the box: below some tens the
            knife edge's fringes fill it; infinite where no body is near.
        bound: What the change may be at most, where bounds were looked at; infinite elsewhere. Where they answer the
            change itself is 0 give or take this, and nothing is known of a finest phase.
        error: What the change that a wave found may be off by, by half as many slabs; infinite where rays come near
            foci and no traced ones are at hand; NaN where not known.
    """

    strehl_change: float
    feature: float
    distance: float
    fresnel_number: float
    crossed_share: float
    curvature: float
    limit: float = GOOD
    answered_by: str = "waves"
    blocked: float = 0.0
    rim_fresnel_number: float = float("inf")
    bound: float = float("inf")
    error: float = float("nan")

    @property
    def good(self) -> bool:
        """Whether rays are known to give the Strehl ratio to within `limit`; not where that is not decided."""
        return abs(self.strehl_change) <= self.limit

    @property
    def decided(self) -> bool:
        """Whether there is a verdict."""
        return self.answered_by != "nobody"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        if not self.decided:
            return (
                "not decided: the traced wavefront does not say by itself, bounds of the field's derivatives allow a "
                f"change of the Strehl ratio by {self.bound:.2g}, {self.limit:g} being allowed, and a wave would cost "
                "much beside this wavefront; ask for it by validity(..., waves=True), or trace a map of "
                f"{FEWEST_MAPPED} pixels across or more"
            )
        if self.answered_by == "bounds":
            return (
                f"rays are good: waves change the Strehl ratio by {self.bound:.2g} at most, {self.limit:g} being "
                "allowed, say bounds of the field's derivatives"
            )
        who = "the traced wavefront" if self.answered_by == "rays" else "a wave through the field"
        error = f" give or take {self.error:.1g}" if np.isfinite(self.error) else ""
        change = f"waves change the Strehl ratio by {self.strehl_change:+.2g}{error}, {self.limit:g} being allowed"
        change += f", says {who}"
        if np.isfinite(self.rim_fresnel_number):
            change += (
                f"; {100.0 * self.blocked:.2g} % of the light ends on the body, past whose rim the rest diffracts with "
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
