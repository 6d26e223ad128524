"""What a pupil's rays miss of the flow: by cuts through it, and by passing beside it; from a sample of its rays."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ...derived import cached_on
from ...medium import IndexField
from ...rays import Pupil, RayBundle
from ..cuts import cuts_crossed, flow_ends, lost, may_lose
from ..lines import bundle_span, check_meeting, face_text

SAMPLE_RAYS = 4096
# At most about so many of them are integrated through the source of a field.
INTEGRATED = 512
RAY_OF_PUPIL = "ray of the pupil"
# The greatest share of a pupil's weight that may lose more than the tolerance by cuts without allow_truncation.
GREATEST_SHARE = 1e-3
# The shares of a pupil's weight that may look past the box without a warning, and without allow_truncation.
PAST_TOLD, PAST_REFUSED = 1e-2, 0.5
MOVE_IT = "The pupil itself is outside the field: move it (in a scene: pupil.center, or receiver.aperture_z). "
ALLOW = "take allow_truncation=True (in a scene: trace.allow_truncation = true)"


class TruncationWarning(UserWarning):
    """A part of a pupil looks through a cut in disturbed air or past the field's box; an answer was given anyhow."""


@dataclass(frozen=True, eq=False)
class PupilAir:
    """What a pupil's rays miss, by shares of its weight."""

    share: float  # loses more than the tolerance by cuts through the field's source
    lost_rms: float  # about the mean over the pupil, of the OPD that is lost so [m]
    place: str  # the face by which most of these rays leave the field's box, in words
    is_outside: bool = False  # whether the pupil's centre is outside the field, which is usually a mistake
    rays: RayBundle | None = None  # the sample of the pupil's rays
    past: float = 0.0  # passes beside the field's box, while others meet it
    ends: str = ""  # a sentence on the disturbed ends of the flow, or empty, see cuts.py

    @property
    def is_truncated(self) -> bool:
        """Whether the share that loses something is greater than is accepted without allow_truncation."""
        return self.share > GREATEST_SHARE

    @property
    def looks_past(self) -> bool:
        """Whether the share that looks past the box is so great that it is warned of."""
        return self.past > PAST_TOLD

    @property
    def described(self) -> str:
        """The loss by cuts in words."""
        return f"{100.0 * self.share:.3g} % of the pupil looks through disturbed air that is cut off {self.place}"

    @property
    def past_described(self) -> str:
        """The share that looks past the box in words."""
        return f"{100.0 * self.past:.3g} % of the pupil looks past the field's box, where the air is taken as ambient"

    @property
    def misses(self) -> tuple[str, ...]:
        """A sentence for each share of the pupil that misses something."""
        said = (self.share, self.described), (self.past, self.past_described)
        return tuple(sentence for share, sentence in said if share > 0.0)

    @property
    def reasons(self) -> tuple[str, ...]:
        """What a plan says of it, a sentence for each."""
        return (*self.misses, self.ends) if self.ends else self.misses

    def check(self, allowed: bool) -> None:
        """Reject a pupil that loses too much, or that mostly looks past the box, unless that is allowed."""
        if allowed:
            return
        move = MOVE_IT if self.is_outside else ""
        if self.is_truncated:
            raise ValueError(
                f"{self.described}: the flow goes on beyond. {move}Give the field a larger region there, look another "
                f'way, or {ALLOW} and read error["truncation"]'
            )
        if self.past > PAST_REFUSED:
            raise ValueError(
                f"{self.past_described}. {move}Check the units (metres are expected), the pupil's position, size and "
                f"direction, give the field a larger box, or {ALLOW}"
            )

    def warn(self) -> None:
        """Warn the caller of what was allowed, and of a pupil of which more than a hundredth looks past the box."""
        if self.is_truncated:
            warn_caller(f"{self.described}: the answer is that of the air in the field's box", TruncationWarning)
        if self.looks_past:
            warn_caller(self.past_described, TruncationWarning)


@cached_on("field", 4)
def pupil_air(
    field: IndexField, pupil: Pupil, look: np.ndarray, tolerance: float, rays: RayBundle | None = None
) -> PupilAir:
    """Find what a pupil's straight rays toward `look` miss; `tolerance` is the requested OPD error [m].

    Raises:
        ValueError: None of its rays meets the field.
    """
    rays = rays or some_rays(field.samples.places, pupil, look, SAMPLE_RAYS)
    check_meeting(field, rays, RAY_OF_PUPIL)
    low, high = field.box
    span, weight = bundle_span(rays, field.geometry, low, high), np.asarray(rays.weight)
    past = 0.0 if span.meets.all() else float(weight[~span.meets].sum())
    share, lost_rms, place = _loss(field, rays, tolerance) if may_lose(field, tolerance) else (0.0, 0.0, "")
    return PupilAir(
        share=share,
        lost_rms=lost_rms,
        place=place,
        is_outside=bool(np.any((pupil.center < low) | (pupil.center > high))),
        rays=rays,
        past=past if past < 1.0 else 0.0,
        ends=flow_ends(field, rays.pilot, None, tolerance),
    )


def _loss(field: IndexField, rays: RayBundle, tolerance: float) -> tuple[float, float, str]:
    """The share of rays' weight that loses more than the tolerance, the rms loss [m], and where most of these leave."""
    faces = cuts_crossed(field, rays)
    weight = np.array(rays.weight)
    concerned = np.flatnonzero((faces >= 0) | ~bundle_span(rays, field.geometry, *field.box).meets)
    if not len(concerned):
        return 0.0, 0.0, ""
    some = concerned
    if len(concerned) > INTEGRATED:  # drawn at random: every eighth point of a Sobol sequence is on one ring
        some = concerned[np.sort(np.random.default_rng(0).permutation(len(concerned))[:INTEGRATED])]
    part = weight[some] * (weight[concerned].sum() / weight[some].sum())
    amount = lost(field, rays.rows(some), None, tolerance=tolerance)
    total = weight.sum()
    mean = float(part @ amount) / total
    square = float(part @ amount**2) / total - mean**2
    over = np.abs(amount) > tolerance
    place = ""
    if over.any():
        number, inverse = np.unique(faces[some[over]], return_inverse=True)
        most = int(number[np.argmax(np.bincount(inverse, part[over]))])
        place = f"at the face {face_text(field, most)}" if most >= 0 else "beside the field's box"
    return float(part[over].sum()), float(np.sqrt(max(square, 0.0))), place


@cached_on("places", 8)
def some_rays(places: Any, pupil: Pupil, look: np.ndarray, count: int) -> RayBundle:
    """Some of a pupil's rays; one object for all fields on the same nodes, because rays cache where they cross them."""
    return RayBundle.collimated(pupil, count, direction=look)
