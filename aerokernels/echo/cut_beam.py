"""Add points to a beam of which rays are lost, and measure the error of the share that is left.

A body that cuts the beam, or another loss, makes the integrand of the sum over the beam's points jump, and Gauss points
no longer converge fast. The points along each side are doubled until the share of the beam that is lost is known well
enough. Its error is SAFETY times the change from the same sum over half as many points a side, or half of the change
from a quarter as many if that is greater: an error falls about threefold from one rule to the next, but two rules may
agree by chance, so that an error below LEAST is not believed.
"""

from ..medium import IndexField
from .paths import TransmitPaths, transmit_paths
from .vacuum import VacuumEcho

# Factor on the change; least error; error of the share above which points are added, and the most that are made.
SAFETY, LEAST, RESOLVED, MOST_POINTS = 1.5, 5e-4, 2e-3, 1 << 17


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
        change, other = (abs(share - lost(part * finer)[2]) for part in (0.5, 0.25))
        error = max(SAFETY * change, 0.5 * SAFETY * other, LEAST)
        if error <= RESOLVED or 4 * len(found.points.weight) > MOST_POINTS:
            return found, paths, error
        finer *= 2.0
