"""The share of a pupil that looks through the ends of the known air, from a sample of its undisturbed rays."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...derived import cached_on
from ...medium import IndexField
from ...rays import Pupil, RayBundle
from ..error_budget.known_air import BESIDE, may_be_lost
from ..lines import box_span, face_text
from ..meeting import check_meeting

SAMPLE_RAYS = 4096
# Pupils and tolerances for which a field, or its nodes, cache what is examined.
CACHED = 4  # speed only
RAY_OF_PUPIL = "ray of the pupil"
# The greatest share of a pupil's weight that may look through the ends of the known air without allow_truncation.
GREATEST_SHARE = 1e-3
MOVE_IT = "The pupil itself is outside the field: move it (in a scene: pupil.center, or receiver.aperture_z). "


class TruncationWarning(UserWarning):
    """More than a thousandth of a pupil looks through the ends of the known air; an answer was given nevertheless."""


@dataclass(frozen=True, eq=False)
class PupilAir:
    """The OPD that a pupil's rays may lose where the known air ends.

    Attributes:
        share: Share of the pupil's weight that may lose more than the tolerance.
        lost_rms: Root mean square over the pupil of the OPD that its rays may lose [m].
        place: The face at which most of these rays leave the known air, in words.
        is_outside: Whether the pupil's centre is outside the field, which is usually a mistake.
        rays: The sample of the pupil's rays.
    """

    share: float
    lost_rms: float
    place: str
    is_outside: bool = False
    rays: RayBundle | None = None

    @property
    def is_truncated(self) -> bool:
        """Whether the share is greater than is accepted without allow_truncation."""
        return self.share > GREATEST_SHARE

    @property
    def described(self) -> str:
        """The truncation in words."""
        return f"{100.0 * self.share:.3g} % of the pupil looks through disturbed air that ends {self.place}"

    def check(self, allowed: bool) -> None:
        """Reject a pupil that is truncated unless that is allowed.

        Raises:
            ValueError: It is truncated and not allowed; the message has the share, the face and the remedies.
        """
        if self.is_truncated and not allowed:
            move = MOVE_IT if self.is_outside else ""
            raise ValueError(
                f"{self.described}: the air beyond is unknown. {move}Give the field a larger region there, look "
                "another way, or take allow_truncation=True (in a scene: trace.allow_truncation = true) and read "
                'error["truncation"]'
            )


@cached_on("field", CACHED)
def pupil_air(
    field: IndexField, pupil: Pupil, look: np.ndarray, tolerance: float, rays: RayBundle | None = None
) -> PupilAir:
    """Estimate the OPD that a pupil's straight rays toward `look` may lose; `tolerance` is the requested OPD error [m].

    `rays` are some of the pupil's rays; None makes them.

    Raises:
        ValueError: None of its rays meets the field.
    """
    rays = rays or _sample_of(field.samples.places, pupil, look)
    check_meeting(field, rays, RAY_OF_PUPIL)
    lost, face = may_be_lost(field, rays, None, tolerance)
    concerned = np.flatnonzero(lost > 0.0)
    if field.body is not None and len(concerned):
        lost[concerned[meets_wall(field, rays.position[concerned], rays.direction[concerned])]] = 0.0
    if not len(concerned):
        return still_air(field, pupil, rays)
    weight = np.asarray(rays.weight)
    over = lost > tolerance
    place = "beside the field's box"
    if over.any():
        number, count = np.unique(face[over], return_counts=True)
        most = int(number[np.argmax(count)])
        if most != BESIDE:
            place = f"at the face {face_text(field, most)}"
        elif not field.is_uniform:
            place = "at the rim of the mesh"
    share, lost_rms = float(weight[over].sum()), float(np.sqrt(weight @ lost**2))
    return replace(still_air(field, pupil, rays), share=share, lost_rms=lost_rms, place=place)


@cached_on("places", CACHED)
def _sample_of(places: Any, pupil: Pupil, look: np.ndarray) -> RayBundle:
    """Some of a pupil's rays; one object for all fields on the same nodes, because rays cache where they cross them."""
    return RayBundle.collimated(pupil, SAMPLE_RAYS, direction=look)


def still_air(field: IndexField, pupil: Pupil, rays: RayBundle) -> PupilAir:
    """The air of a pupil whose rays lose nothing; `rays` are some of them."""
    low, high = field.box
    outside = bool(np.any((pupil.center < low) | (pupil.center > high)))
    return PupilAir(0.0, 0.0, "beside the field's box", outside, rays)


def meets_wall(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which straight rays end on the body: they enter it, or they start in it and never leave it.

    A line along x through planar air never leaves the field and is not counted.
    """
    assert field.body is not None
    span = box_span(field, position, direction)
    walls = field.body.crossings(position, direction)
    walls = np.pad(walls, ((0, 0), (0, 2)), constant_values=np.inf)
    before = np.count_nonzero((walls <= span.enter[:, None]) & np.isfinite(walls), axis=1)
    inside = before % 2 == 1
    rows = np.arange(len(walls))
    leaves, enters = walls[rows, before], walls[rows, before + inside]
    return span.meets & (span.leave < 1e30) & ((enters <= span.leave) | inside & (leaves > span.leave))
