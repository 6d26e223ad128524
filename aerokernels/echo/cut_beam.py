"""Add points to a beam of which rays are lost, and measure the error of the share that is left.

A body that cuts the beam, or another loss, makes the integrand of the sum over the beam's points jump, and Gauss points
no longer converge fast. The points along each side are doubled until the share of the beam that is lost is known well
enough. Its error is twice the greatest change from the same sum over half and over a quarter as many points a side: an
error falls about threefold from one rule to the next, but two rules may agree by chance.
"""

from functools import cache

from ..medium import IndexField
from .paths import TransmitPaths, transmit_paths
from .vacuum import VacuumEcho

# Factor on the change; error of the lost share above which points are added, and the most points that are made.
SAFETY, RESOLVED, MOST_POINTS = 2.0, 2e-3, 1 << 17


def cut_beam(vacuum: VacuumEcho, field: IndexField) -> tuple[VacuumEcho, TransmitPaths, float]:
    """Return the echo in vacuum over enough points, their paths through a field, and the error of the lost share."""

    @cache
    def lost(finer: float) -> tuple[VacuumEcho, TransmitPaths, float]:
        points = vacuum if finer == 1.0 else VacuumEcho.of(vacuum.scene, vacuum.limits, finer)
        paths = transmit_paths(vacuum.scene, field, points.points)
        return points, paths, float(points.points.weight[~paths.arrived].sum())

    finer = 1.0
    while True:
        found, paths, share = lost(finer)
        if not 0.0 < share < float(found.points.weight.sum()):
            return found, paths, 0.0
        error = SAFETY * max(abs(share - lost(part * finer)[2]) for part in (0.5, 0.25))
        if error <= RESOLVED or 4 * len(found.points.weight) > MOST_POINTS:
            return found, paths, error
        finer *= 2.0
