"""Write an OpenFOAM case: inviscid supersonic air over the wind-tunnel model, in a wedge of 5 degrees about the axis.

The solver is rhoCentralFoam (Kurganov's central-upwind flux) with local time steps. Two stages share a case and differ
in their `Stage`: plain local time steps move the bow shock to its position quickly but never settle; with a limit on
the step the solution settles.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path

import model

from aerokernels.flow import GAS_CONSTANT_AIR, FreeStream

HALF_WEDGE = radians(2.5)
UNIVERSAL_GAS_CONSTANT = 8314.4626  # J/(kmol K)
HEADER = "FoamFile\n{{\n    version 2.0;\n    format ascii;\n    class {kind};\n    object {name};\n}}\n\n"


@dataclass(frozen=True)
class Stage:
    """How long and how carefully to iterate.

    Attributes:
        step_count: Iterations.
        write_interval: Iterations between dumps.
        courant: Courant number of the local time steps.
        longest_step: Cap on the local time steps [s].
        smoothing: How strongly neighbouring time steps are evened out.
    """

    step_count: int
    write_interval: int
    courant: float
    longest_step: float
    smoothing: float


def write_wedge_case(folder: Path, stream: FreeStream, scale: float) -> None:
    """Everything but the stage, of axisymmetric flow along the body."""
    write_case(folder, stream, _mesh(model.outer_edge(stream.mach), scale), {"front": "wedge", "back": "wedge"})


def write_case(folder: Path, stream: FreeStream, mesh: str, sides: Mapping[str, str], alpha: float = 0.0) -> None:
    """Everything but the stage: mesh description, schemes, gas, and the free stream as the first guess.

    Args:
        folder: The case.
        stream: The free stream.
        mesh: The body of its blockMeshDict.
        sides: The types of the patches that bound it sideways, by name.
        alpha: Angle of incidence [rad].
    """
    _write(folder, "system/blockMeshDict", "dictionary", mesh)
    _write(folder, "system/fvSchemes", "dictionary", SCHEMES)
    _write(folder, "system/fvSolution", "dictionary", SOLUTION)
    heat = stream.gamma / (stream.gamma - 1.0) * GAS_CONSTANT_AIR
    gas = GAS.format(weight=UNIVERSAL_GAS_CONSTANT / GAS_CONSTANT_AIR, heat=heat)
    _write(folder, "constant/thermophysicalProperties", "dictionary", gas)
    _write(folder, "constant/turbulenceProperties", "dictionary", "simulationType laminar;\n")
    velocity = f"({stream.velocity * cos(alpha):.10g} {stream.velocity * sin(alpha):.10g} 0)"
    for name, kind, dimensions, value, at_wall in (
        ("p", "volScalarField", "[1 -1 -2 0 0 0 0]", f"{stream.pressure:.10g}", "zeroGradient"),
        ("T", "volScalarField", "[0 0 0 1 0 0 0]", f"{stream.temperature:.10g}", "zeroGradient"),
        ("U", "volVectorField", "[0 1 -1 0 0 0 0]", velocity, "slip"),
    ):
        lines = [f"    {side} {{ type {bound}; }}\n" for side, bound in sides.items()]
        text = f"""dimensions {dimensions};
internalField uniform {value};
boundaryField
{{
    inlet {{ type fixedValue; value uniform {value}; }}
    outlet {{ type zeroGradient; }}
    body {{ type {at_wall}; }}
{"".join(lines)}}}
"""
        _write(folder, f"0/{name}", kind, text)


def write_stage(folder: Path, stage: Stage) -> None:
    """The control file of one stage."""
    entries = {
        "application": "rhoCentralFoam",
        "startFrom": "startTime",
        "startTime": 0,
        "stopAt": "endTime",
        "endTime": stage.step_count,
        "deltaT": 1,
        "adjustTimeStep": "no",
        "writeControl": "timeStep",
        "writeInterval": stage.write_interval,
        "writeFormat": "ascii",
        "writePrecision": 12,
        "timePrecision": 10,
        "runTimeModifiable": "false",
        "maxCo": stage.courant,
        "maxDeltaT": stage.longest_step,
        "rDeltaTSmoothingCoeff": stage.smoothing,
    }
    text = "".join(f"{key} {value};\n" for key, value in entries.items())
    _write(folder, "system/controlDict", "dictionary", text)


def _mesh(edge: model.OuterEdge, scale: float) -> str:
    """One layer of blocks between the body (B0, B1, ...) and the outer edge (Q0, Q1, ...)."""
    body, rim = model.body_corners(), model.edge_corners(edge)
    along, across = model.cell_counts(scale)
    points: list[str] = []
    index: dict[str, tuple[int, int]] = {}
    for name, corners in (("B", body), ("Q", rim)):
        for number, (x, r) in enumerate(corners):
            # On the axis the two faces of the wedge share one point.
            sides = (0,) if r == 0.0 else (-1, 1)
            index[f"{name}{number}"] = (len(points), len(points) + len(sides) - 1)
            points += [_point(x, r, side) for side in sides]
    quads = [(f"B{k}", f"B{k + 1}", f"Q{k + 1}", f"Q{k}") for k in range(len(along))]
    front = [" ".join(str(index[name][0]) for name in quad) for quad in quads]
    back = [" ".join(str(index[name][1]) for name in quad) for quad in quads]
    blocks = [
        f"hex ({near} {far}) ({count} {across} 1) simpleGrading ({grading:g} 1 1)"
        for near, far, count, (_, grading) in zip(front, back, along, model.BLOCKS, strict=True)
    ]
    curves = [("B0", "B1", model.dome_curve())]
    curves += [(f"Q{k}", f"Q{k + 1}", model.edge_curve(edge, rim[k][1], rim[k + 1][1])) for k in range(len(along))]
    edges = [
        f"polyLine {index[first][side]} {index[last][side]} ({' '.join(_point(x, r, 2 * side - 1) for x, r in curve)})"
        for first, last, curve in curves
        for side in (0, 1)
    ]

    def faces(pairs):
        return [f"{index[a][0]} {index[b][0]} {index[b][1]} {index[a][1]}" for a, b in pairs]

    last = len(along)
    patches = {
        "inlet": ("patch", faces((f"Q{k}", f"Q{k + 1}") for k in range(last))),
        "outlet": ("patch", faces([(f"B{last}", f"Q{last}")])),
        "body": ("wall", faces((f"B{k}", f"B{k + 1}") for k in range(last))),
        "front": ("wedge", front),
        "back": ("wedge", back),
    }
    return mesh_text(points, blocks, edges, patches)


def mesh_text(points, blocks, edges, patches) -> str:
    """The body of a blockMeshDict in millimetres, from its lines, and the type and faces of each patch by its name."""
    boundary = [
        f"{name} {{ type {kind}; faces ({' '.join(f'({face})' for face in listed)}); }}"
        for name, (kind, listed) in patches.items()
    ]
    parts = {"vertices": points, "blocks": blocks, "edges": edges, "boundary": boundary}
    return "scale 0.001;\n\n" + "".join(f"{name}\n(\n" + "\n".join(rows) + "\n);\n\n" for name, rows in parts.items())


def _point(x: float, r: float, side: int) -> str:
    return f"({x:.10g} {r * cos(HALF_WEDGE):.10g} {side * r * sin(HALF_WEDGE):.10g})"


def _write(folder: Path, place: str, kind: str, text: str) -> None:
    path = folder / place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(HEADER.format(kind=kind, name=path.name) + text, encoding="ascii")


SCHEMES = """fluxScheme Kurganov;
ddtSchemes { default localEuler; }
gradSchemes { default Gauss linear; }
divSchemes { default none; div(tauMC) Gauss linear; }
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes
{
    default linear;
    reconstruct(rho) vanAlbada;
    reconstruct(U) vanAlbadaV;
    reconstruct(T) vanAlbada;
}
snGradSchemes { default corrected; }
"""
SOLUTION = """solvers
{
    "(rho|rhoU|rhoE)" { solver diagonal; }
    U { solver smoothSolver; smoother GaussSeidel; nSweeps 2; tolerance 1e-09; relTol 0.01; }
    h { $U; tolerance 1e-10; relTol 0; }
    e { $U; tolerance 1e-10; relTol 0; }
}
"""
GAS = """thermoType
{{
    type hePsiThermo; mixture pureMixture; transport const; thermo hConst;
    equationOfState perfectGas; specie specie; energy sensibleInternalEnergy;
}}
mixture
{{
    specie {{ molWeight {weight:.10g}; }}
    thermodynamics {{ Cp {heat:.10g}; Hf 0; }}
    transport {{ mu 0; Pr 0.72; }}
}}
"""
