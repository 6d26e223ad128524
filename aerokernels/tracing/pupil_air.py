"""How much of a pupil looks through the ends of the known air: from a sample of its rays, before any is traced."""

from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..rays import Disc, RayBundle
from .known_air import BESIDE, may_be_lost
from .lines import box_span, face_text
from .meeting import check_meeting

SAMPLE_RAYS = 4096
# The greatest share of a pupil's weight that may see through the ends of the known air unasked.
GREATEST_SHARE = 1e-3
# Points along a ray at which the body is looked for in its way.
WALL_POINTS = 256


@dataclass(frozen=True, eq=False)
class PupilAir:
    """What a pupil may lose where the known air ends.

    Attributes:
        share: Share of the pupil's weight that may lose more than the tolerance.
        lost_rms: Root mean square over the pupil of what its rays may lose [m].
        place: The face at which most of the concerned rays leave the known air, in words.
    """

    share: float
    lost_rms: float
    place: str

    @property
    def is_truncated(self) -> bool:
        """Whether it is more than may be unasked."""
        return self.share > GREATEST_SHARE

    @property
    def described(self) -> str:
        """What is wrong, in words."""
        return f"{100.0 * self.share:.3g} % of the pupil looks through disturbed air that ends {self.place}"

    def check(self, allowed: bool) -> None:
        """Refuse a pupil that is truncated unless that is allowed.

        Raises:
            ValueError: It is not, with the share, the face and the remedies.
        """
        if self.is_truncated and not allowed:
            raise ValueError(
                f"{self.described}: what lies beyond is unknown. Give the field a larger region there, look another "
                "way, or take allow_truncation=True (in a scene: trace.allow_truncation = true) and read "
                'error["truncation"]'
            )


def pupil_air(field: IndexField, pupil: Disc, look: np.ndarray, tolerance: float) -> PupilAir:
    """What a pupil may lose along straight rays toward `look`; `tolerance` is the OPD error asked for [m].

    Raises:
        ValueError: None of its rays meets the field.
    """
    rays = RayBundle.collimated(pupil, SAMPLE_RAYS, direction=look)
    check_meeting(field, rays, "ray of the pupil")
    lost, face = may_be_lost(field, rays, None, tolerance)
    concerned = np.flatnonzero(lost > 0.0)
    if field.body is not None and len(concerned):
        lost[concerned[_meets_wall(field, rays.position[concerned], rays.direction[concerned])]] = 0.0
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
    return PupilAir(float(weight[over].sum()), float(np.sqrt(weight @ lost**2)), place)


def _meets_wall(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which straight rays end on the body: they get into it, or never out of it where they start in it."""
    found = np.zeros(len(position), dtype=bool)
    span = box_span(field, position, direction)
    rows = np.flatnonzero(span.meets & (span.leave < 1e30))
    enter, leave = span.enter[rows, None], span.leave[rows, None]
    distance = enter + (np.arange(WALL_POINTS) + 0.5) / WALL_POINTS * (leave - enter)
    places = position[rows, None] + distance[..., None] * direction[rows, None]
    assert field.wall_distance is not None
    inside = field.wall_distance.evaluate(field.local_coordinates(places.reshape(-1, 3))).reshape(distance.shape) < 0.0
    was_out = np.cumsum(~inside, axis=1) > 0
    found[rows] = (inside & was_out).any(axis=1) | ~was_out[:, -1]
    return found
