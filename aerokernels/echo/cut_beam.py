"""Add points to a beam of which rays are lost, and measure the error of the share that is left.

A body that cuts the beam, or another loss, makes the integrand of the sum over the beam's points jump, and Gauss points
no longer converge fast. The points along each side are doubled until the share of the beam that is lost is known well
enough. Its error is the change from the same sum over half as many points a side and a third of that from a quarter as
many, as independent errors: an error falls about threefold from one rule to the next, but two may agree by chance.
"""

import math

from ..medium import IndexField
from .paths import TransmitPaths, transmit_paths
from .vacuum import VacuumEcho

# Error of the share above which points are added, and the most that are made.
RESOLVED, MOST_POINTS = 2e-3, 1 << 17


def cut_beam(vacuum: VacuumEcho, field: IndexField) -> tuple[VacuumEcho, TransmitPaths, float]:
    """Return the echo in vacuum over enough points, their paths through a field, and the error of the lost share."""
    known: dict[float, tuple[VacuumEcho, TransmitPaths, float]] = {}

    def lost(finer: float) -> tuple[VacuumEcho, TransmitPaths, float]:
        if finer not in known:
            echo = vacuum if finer == 1.0 else VacuumEcho.of(vacuum.scene, vacuum.limits, finer)
            paths = transmit_paths(vacuum.scene, field, echo.points)
            known[finer] = echo, paths, float(echo.points.weight[~paths.arrived].sum())
        return known[finer]

    finer = 1.0
    while True:
        found, paths, share = lost(finer)
        if not 0.0 < share < float(found.points.weight.sum()):
            return found, paths, 0.0
        error = math.hypot(share - lost(0.5 * finer)[2], (share - lost(0.25 * finer)[2]) / 3.0)
        if error <= RESOLVED or 4 * len(found.points.weight) > MOST_POINTS:
            return found, paths, error
        finer *= 2.0
