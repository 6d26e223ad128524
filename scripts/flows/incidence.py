"""Compute the dome of the wind-tunnel model at an angle of attack, in space, like flow/data/dome-alpha10.npz.

    .venv/bin/python scripts/flows/incidence.py OUT.npz [--mach 3] [--alpha 10] [--folder CASE] [--from-folder]

The region is the dome and the beginning of the cone behind it, and one half of it, because the flow is symmetric:
32,000 hexahedra, some ten minutes of one core. The half is interpolated to a uniform grid about the dome. Needs
OpenFOAM, as make.py does.
"""

import argparse
import shutil
import tempfile
from dataclasses import astuple
from math import cos, degrees, pi, radians, sin, tan
from pathlib import Path

import case
import make
import model
import numpy as np

from aerokernels import flow
from aerokernels.flow import FreeStream, tunnel_conditions

ALONG, ACROSS, AROUND = (24, 16), 44, 18
CONE_GRADING = 2.5
LENGTH = 20.0  # of the body from the nose tip [mm]
WIDER = radians(10.0)  # than at zero incidence: the angle of the outer edge
STAND_OFF = 0.6  # more than at zero incidence [mm]
STAGES = (
    case.Stage(1500, 1500, courant=0.3, longest_step=1.0, smoothing=0.1),
    case.Stage(2400, 200, courant=0.15, longest_step=1e-7, smoothing=0.2),
)
AVERAGED_DUMPS = 6
# The grid about the dome, in the optical frame, one half of it [m].
LOW, HIGH, SPACING = (0.0, -0.009, -0.0084), (0.009, 0.009, 0.0028), 0.00012
KEPT_BITS = 14  # of each density: a part in 30,000, far below the solver's own error


def main() -> None:
    """Write the case, run it, draw it into the grid."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--mach", type=float, default=3.0, help="2, 3 or 4")
    parser.add_argument("--alpha", type=float, default=10.0, help="angle of attack [deg], up to 10")
    parser.add_argument("--folder", type=Path, help="keep the OpenFOAM case here")
    parser.add_argument("--from-folder", action="store_true", help="the case has been run there: draw it alone")
    given = parser.parse_args()
    if given.mach not in make.STAGNATION_PRESSURE or not 0.0 <= given.alpha <= degrees(WIDER) + 1e-9:
        parser.error(f"Mach 2, 3 or 4, and an angle from 0 to {degrees(WIDER):g} degrees")
    if not given.from_folder and shutil.which("blockMesh") is None:
        parser.error("blockMesh is not on the path: install OpenFOAM, as with apt-get install openfoam")
    stream = tunnel_conditions(given.mach, make.STAGNATION_PRESSURE[given.mach], make.STAGNATION_TEMPERATURE)
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.folder or Path(scratch)
        if not given.from_folder:
            compute(folder, stream, radians(given.alpha))
        arrays = drawn(folder, stream)
    np.savez_compressed(given.out, **arrays, alpha=radians(given.alpha), **make.free_stream(stream))


def compute(folder: Path, stream: FreeStream, alpha: float) -> None:
    """Write and run the case."""
    case.write_case(folder, stream, mesh(stream.mach), {"symmetry": "symmetryPlane"}, alpha)
    case.write_stage(folder, STAGES[0])
    make.run(folder, "blockMesh")
    make.run(folder, "checkMesh")
    make.run(folder, "rhoCentralFoam", "start")
    done = folder / str(STAGES[0].step_count)
    for name in ("p", "T", "U"):
        shutil.copy(done / name, folder / "0" / name)
    shutil.rmtree(done)
    case.write_stage(folder, STAGES[1])
    make.run(folder, "rhoCentralFoam", "finish")


def drawn(folder: Path, stream: FreeStream) -> dict[str, np.ndarray]:
    """The mean of the last dumps on the grid, in single precision, and its spread over them."""
    times = sorted(float(p.name) for p in folder.iterdir() if p.name.replace(".", "").isdigit() and p.name != "0")
    reader = flow.Reader(
        frame="-x", spacing=SPACING, region=(LOW, HIGH), ambient_density=stream.density, walls=[], density="rho"
    )
    fields = [reader(folder, time=time) for time in times[-AVERAGED_DUMPS:]]
    density = np.mean([one.density for one in fields], axis=0)
    spread = np.std([one.density for one in fields], axis=0)
    print(f"{len(fields)} dumps; spread {spread.mean() / stream.density:.3g} of the free stream in the mean")
    print(fields[-1].provenance)
    return {
        "rho": rounded(density.astype(np.float32)),
        "origin": fields[0].origin,
        "spacing": fields[0].spacing,
        "profile": 1e-3 * profile(),
        "resampling": np.array(astuple(fields[-1].resampling)[1:]),
    }


def rounded(values: np.ndarray) -> np.ndarray:
    """Single precision with fewer bits, by which the file is a third of its size."""
    dropped = 23 - KEPT_BITS
    bits = values.view(np.uint32)
    half = np.uint32(1 << (dropped - 1))
    return ((bits + half) & np.uint32(0xFFFFFFFF << dropped & 0xFFFFFFFF)).view(np.float32)


def profile() -> np.ndarray:
    """The body's outline (r, z) [mm] in the optical frame, from the nose tip to the base and back to the axis."""
    angle = np.linspace(0.0, 0.5 * pi - model.FORE_CONE, 41)
    dome = model.NOSE_RADIUS * np.stack([np.sin(angle), np.cos(angle) - 1.0], axis=1)
    dome[0] = 0.0
    x, r = end_of_body()
    return np.vstack([dome, [r, -x], [0.0, -x]])


def end_of_body() -> tuple[float, float]:
    """Where the body ends (x, r) [mm]."""
    x, r = model.body_corners()[1]
    return LENGTH, r + (LENGTH - x) * tan(model.FORE_CONE)


def mesh(mach: float) -> str:
    """Two blocks along the body in each of the sectors about the axis, one cell wide: x downstream, y upward."""
    known = model.outer_edge(mach)
    edge = model.OuterEdge(known.stand_off + STAND_OFF, known.apex_radius, known.asymptote + WIDER)
    body = [*model.body_corners()[:2], end_of_body()]
    leans = (model.LEAN[0], 0.0)
    rim = [(-edge.stand_off, 0.0), *(edge.met_from(*pair) for pair in zip(body[1:], leans, strict=True))]
    points: list[str] = []
    index: dict[str, list[int]] = {}
    angles = np.linspace(0.0, pi, AROUND + 1)
    for name, corners in (("B", body), ("Q", rim)):
        for number, (x, r) in enumerate(corners):
            turned = [0.0] * 1 if r == 0.0 else angles
            first = len(points)
            points += [point(x, r, angle) for angle in turned]
            index[f"{name}{number}"] = [first + k * (len(turned) > 1) for k in range(AROUND + 1)]
    quads = [(f"B{k}", f"B{k + 1}", f"Q{k + 1}", f"Q{k}") for k in range(2)]

    def plane(quad, sector):
        return " ".join(str(index[name][sector]) for name in quad)

    def shell(first, last):
        return [f"{index[first][m]} {index[last][m]} {index[last][m + 1]} {index[first][m + 1]}" for m in range(AROUND)]

    blocks = [
        f"hex ({plane(quad, m)} {plane(quad, m + 1)}) ({count} {ACROSS} 1) simpleGrading ({grading:g} 1 1)"
        for m in range(AROUND)
        for quad, count, grading in zip(quads, ALONG, (1.0, CONE_GRADING), strict=True)
    ]
    curves = [("B0", "B1", model.dome_curve())]
    curves += [(f"Q{k}", f"Q{k + 1}", model.edge_curve(edge, rim[k][1], rim[k + 1][1])) for k in range(2)]
    edges = [
        f"polyLine {index[a][m]} {index[b][m]} ({' '.join(point(x, r, angle) for x, r in curve)})"
        for a, b, curve in curves
        for m, angle in enumerate(angles)
    ]
    patches = {
        "inlet": ("patch", shell("Q0", "Q1") + shell("Q1", "Q2")),
        "outlet": ("patch", shell("B2", "Q2")),
        "body": ("wall", shell("B0", "B1") + shell("B1", "B2")),
        "symmetry": ("symmetryPlane", [plane(quad, m) for m in (0, AROUND) for quad in quads]),
    }
    return case.mesh_text(points, blocks, edges, patches)


def point(x: float, r: float, angle: float) -> str:
    """A point by its angle from +y about the axis."""
    return f"({x:.10g} {r * cos(angle):.10g} {r * sin(angle) if 0.0 < angle < pi else 0.0:.10g})"


if __name__ == "__main__":
    main()
