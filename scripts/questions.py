"""Sweeps that answer one question each: numbers with their errors, a figure, and the answer in whole sentences.

    altitude     Strehl ratio and range error against Mach number and altitude
    aperture     Strehl ratio and light in the focus against the pupil's diameter
    look-angle   Strehl ratio and boresight error against the angle to the axis
    tolerance    cost and benefit of a tolerance

All of them use the shipped fields (mach2, mach3, mach4) with the shipped scene at sea level. An inviscid flow keeps its
shape when its density is scaled, so an altitude is represented by its density.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.jobs.sweeps.run import sweep
from aerokernels.pupils import Disc
from aerokernels.scene import Scene
from aerokernels.series import look_map
from scripts.studies.report import filled, markdown_table, saved_figure

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "questions.md"

SCENE, FLOWS = "sea-level-mach3", ("mach2", "mach3", "mach4")
MACH = {"mach2": "Mach 2", "mach3": "Mach 3", "mach4": "Mach 4"}
COLOURS = {"mach2": "#0b6e99", "mach3": "#b45309", "mach4": "#be123c"}
GOOD = 0.95  # a Strehl ratio that counts as nearly perfect
SMALL = 0.01  # a range error that counts as small [m]
# Settings for a quick look: few rays, few points of the target, a coarse grid.
QUICK = {"strehl.ray_count": 1024, "receiver.ray_count": 32, "beam.ray_count": 32, "grid.spacing": "0.2 mm"}


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to a question.

    Attributes:
        sentences: The answer in sentences.
        table: The numbers behind it, in Markdown.
        draw: Draws the picture into a Matplotlib figure.
    """

    sentences: tuple[str, ...]
    table: str
    draw: Callable[[Any], None]

    @property
    def text(self) -> str:
        """Sentences and table."""
        return "\n".join([*(f"- {one}" for one in self.sentences), "", self.table])

    def save(self, path: Any) -> None:
        """Write the picture."""
        with saved_figure(path, 10.0, 4.2) as figure:
            self.draw(figure)


class Curves(NamedTuple):
    """A quantity of each flow with its errors, shapes (flow, place); `words` has the unit, `note` is for legends."""

    words: str
    value: np.ndarray
    error: np.ndarray
    note: str = ""
    style: str = "-"


def by_flow(
    sentences: Sequence[str],
    flows: Sequence[str],
    label: str,
    places: np.ndarray,
    columns: Mapping[str, Curves],
    panels: Mapping[str, Sequence[Curves]],
    more: Mapping[str, Sequence[str]] | None = None,
    dotted: np.ndarray | None = None,
    every: int = 1,
) -> Answer:
    """Return an answer with a row for `every` one of the places, and a curve for each flow.

    `columns` of the table are given by heading, `panels` by title; `more` are text columns that come first. `dotted` is
    the perfect pupil's line in the last panel, shape (place,).
    """
    texts = [[f"{place:g}" for place in places], *(more or {}).values()]
    texts += [
        list(map(with_error, *of_flow))
        for one in columns.values()
        for of_flow in zip(one.value, one.error, strict=True)
    ]
    heading = [label, *(more or {}), *(f"{words}, {MACH[flow]}" for words in columns for flow in flows)]

    def draw(figure: Any) -> None:
        drawn = figure.subplots(1, len(panels))
        for axes, (title, curves) in zip(drawn, panels.items(), strict=True):
            for one in curves:
                for flow, value, error in zip(flows, one.value, one.error, strict=True):
                    look = {"color": COLOURS[flow], "marker": "o", "markersize": 4, "linestyle": one.style}
                    axes.errorbar(places, value, error, label=f"{MACH[flow]}{one.note}", **look)
            axes.set(xlabel=label, ylabel=curves[0].words, title=title)
        if dotted is not None:
            drawn[-1].plot(places, dotted, ":", color="#4a5460", label="perfect")
        for axes in drawn:
            axes.legend(fontsize=8)

    return Answer(tuple(sentences), markdown_table(heading, [*zip(*texts, strict=True)][::every], 0), draw)


def standard_density(altitude: float) -> float:
    """Density [kg/m3] of the US Standard Atmosphere 1976 at a geopotential altitude [m], from 0 to 20 km."""
    gas, gravity, lapse, ground = 287.0528, 9.80665, 6.5e-3, 288.15
    if not 0.0 <= altitude <= 20e3:
        raise ValueError(f"altitude must lie between 0 and 20 km, got {altitude:g} m")
    low = min(altitude, 11e3)
    temperature = ground - lapse * low
    pressure = 101325.0 * (temperature / ground) ** (gravity / (gas * lapse))
    pressure *= np.exp(-gravity * (altitude - low) / (gas * temperature))
    return float(pressure / (gas * temperature))


def with_error(value: float, error: float, scale: float = 1.0) -> str:
    """Return a number with its error as text."""
    return str(Quantity(float(value), float(error)).scaled(scale, "")).replace("+-", "±")


def first_lasting(good: np.ndarray) -> int:
    """Return the first index from which every entry holds; the length where the last does not; shape (n,)."""
    return int(len(good) - np.argmin([*good[::-1], False]))


def altitude(flows: Sequence[str] = FLOWS, kilometres: Sequence[float] = (), settings: Any = None) -> Answer:
    """Strehl ratio and range error against Mach number and altitude."""
    heights = np.array(kilometres or (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0))
    methods = ("leading-edge", "constant-fraction")
    vary: dict[str, list] = {
        "flow.source": list(flows),
        "flow.density": [standard_density(1e3 * one) for one in heights],
        "detector.ranging": list(methods),
    }
    found = sweep(SCENE, vary, settings=settings)
    number = {name: found[name].values for name in ("strehl", "strehl_error", "range_error_m", "range_error_m_error")}
    strehl, error = (number[name][:, :, 0] for name in ("strehl", "strehl_error"))
    sentences = []
    for a, flow in enumerate(flows):
        first = first_lasting(strehl[a] >= GOOD)
        reached = f"below {GOOD:g} at the greatest altitude"
        if first < len(heights):
            at_least = with_error(strehl[a, first], error[a, first])
            reached = f"at least {GOOD:g} from {heights[first]:g} km on, {at_least} there"
        sentences.append(
            f"At {MACH[flow]} the Strehl ratio of the 12 mm pupil is {with_error(strehl[a, 0], error[a, 0])} at "
            f"{heights[0]:g} km, and {reached}."
        )
    ranges = []
    for k, (method, style) in enumerate(zip(methods, ("-", "--"), strict=True)):
        shift, off = number["range_error_m"][:, :, k], number["range_error_m_error"][:, :, k]
        ranges.append(Curves("reported − true range [mm]", 1e3 * shift, 1e3 * off, f", {method}", style))
        worst = np.unravel_index(int(np.nanargmax(np.abs(shift))), shift.shape)
        first = first_lasting((np.abs(shift) < SMALL).all(axis=0))
        after = f"above {1e3 * SMALL:g} mm for a Mach number at the greatest altitude"
        if first < len(heights):
            after = f"below {1e3 * SMALL:g} mm at all Mach numbers from {heights[first]:g} km on"
        sentences.append(
            f"The range error by {method} is greatest at {MACH[flows[worst[0]]]} and {heights[worst[1]]:g} km, "
            f"{with_error(shift[worst], off[worst], 1e3)} mm, and {after}."
        )
    ratio = Curves("Strehl ratio", strehl, error)
    return by_flow(
        sentences,
        flows,
        "altitude [km]",
        heights,
        {"Strehl ratio": ratio, "leading edge [mm]": ranges[0]},
        {"12 mm pupil behind the dome": [ratio], "Range error at 1.5 m": ranges},
        {"density [kg/m³]": [f"{density:.4f}" for density in vary["flow.density"]]},
    )


def aperture(flows: Sequence[str] = FLOWS, millimetres: Sequence[float] = (), settings: Any = None) -> Answer:
    """Strehl ratio, and the light that it leaves in the focus, against the pupil's diameter."""
    diameters = np.array(millimetres or (2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0))
    vary = {"flow.source": list(flows), "receiver.diameter": [1e-3 * one for one in diameters]}
    found = sweep(SCENE, vary, settings=settings)
    strehl, error = found.strehl.values, found.strehl_error.values
    light, light_error = strehl * diameters**2, error * diameters**2  # in the core of the focus [mm2], without pi / 4
    sentences = []
    for a, flow in enumerate(flows):
        best = int(np.argmax(light[a]))
        width = float(np.sqrt(light[a, best]))
        sentences.append(
            f"At {MACH[flow]} at sea level the Strehl ratio is {with_error(strehl[a, 0], error[a, 0])} at "
            f"{diameters[0]:g} mm and {with_error(strehl[a, -1], error[a, -1])} at {diameters[-1]:g} mm; of the "
            f"diameters tried {diameters[best]:g} mm collects most light into the core of the focus, as much as a "
            f"perfect pupil of {with_error(width, 0.5 * light_error[a, best] / width)} mm."
        )
    ratio = Curves("Strehl ratio", strehl, error)
    core = Curves("Strehl ratio × diameter² [mm²]", light, light_error)
    return by_flow(
        sentences,
        flows,
        "diameter [mm]",
        diameters,
        {"Strehl ratio": ratio},
        {"Strehl ratio at sea level": [ratio], "Light in the core": [core]},
        dotted=diameters**2,
    )


def look_angle(
    flows: Sequence[str] = FLOWS, degrees: Sequence[float] = (), ray_count: int = 4096, tolerance: float = 1e-3
) -> Answer:
    """Strehl ratio and boresight error against the angle to the axis."""
    angles = np.array(degrees or np.arange(0.0, 61.0, 5.0))
    scene = Scene.load(SCENE)
    pupil = Disc(0.5 * scene.receiver.diameter, [0.0, 0.0, scene.receiver.aperture_z])
    maps = []
    for flow in flows:
        field = Scene.load(SCENE, {"flow.source": flow}).density_field()
        index = field.index_field(scene.flow.wavelength, scene.flow.relation)  # as in the other questions
        maps.append(look_map(index, [0.0], np.radians(angles), pupil, ray_count=ray_count, tolerance=tolerance))
    strehl, error, boresight, boresight_error, known = (
        np.array([one[name].values[0] for one in maps])
        for name in ("strehl", "strehl_error", "boresight", "boresight_error", "known")
    )
    sentences = []
    for a, flow in enumerate(flows):
        most = int(np.nanargmax(boresight[a]))
        sentences.append(
            f"At {MACH[flow]} at sea level the Strehl ratio is {with_error(strehl[a, 0], error[a, 0])} straight ahead "
            f"and {with_error(strehl[a, -1], error[a, -1])} at {angles[-1]:g} degrees; of the angles tried the "
            f"boresight error is greatest at {angles[most]:g} degrees, "
            f"{with_error(boresight[a, most], boresight_error[a, most], 1e6)} µrad."
        )
    lost = int((known < 0.5).sum())
    sentences.append(
        "The light stays in the computed air in all of these directions."
        if lost == 0
        else f"In {lost} of the {known.size} directions the computed flow ends in disturbed air before the light does, "
        "and the numbers hold the known part only."
    )
    ratio = Curves("Strehl ratio", strehl, error)
    away = Curves("boresight error [µrad]", 1e6 * boresight, 1e6 * boresight_error)
    return by_flow(
        sentences,
        flows,
        "angle [deg]",
        angles,
        {"Strehl ratio": ratio, "boresight error [µrad]": away},
        {"12 mm pupil behind the dome, sea level": [ratio], "Where the beam points": [away]},
        every=2,
    )


def tolerance(
    tolerances: Sequence[float] = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4),
    settings: Any = None,
    tightest: float = 1e-5,
) -> Answer:
    """Cost and benefit of a tolerance: error-controlled steps against those of a far tighter tolerance."""
    base = {"trace.method": "adaptive", "strehl.ray_count": 20_000, **(settings or {})}
    vary = {"trace.tolerance": [*tolerances, tightest], "trace.precision": ["float32", "float64"]}
    found = sweep(SCENE, vary, settings=base)
    strehl, reported = found.strehl.values, found.strehl_error.values
    evaluations = found.evaluation_count.values / found.traced_ray_count.values
    truth, truth_error = strehl[-1, 1], reported[-1, 1]
    off = np.abs(strehl - truth)[:-1]
    asked = np.array(tolerances)
    usual = int(np.argmin(np.abs(np.log(asked / 1e-3))))
    last = len(asked) - 1
    sentences = [
        f"At the tolerance of {asked[usual]:g} waves the Strehl ratio at Mach 3 at sea level is "
        f"{with_error(strehl[usual, 0], reported[usual, 0])} in float32, by {evaluations[usual, 0]:.1f} evaluations a "
        f"ray; with {tightest:g} waves in float64 the same rays give {with_error(truth, truth_error)}, so that "
        f"{off[usual, 0]:.1e} of it is the steps' and the rounding's.",
        f"At {asked[0]:g} waves the cost is {evaluations[0, 0]:.1f} evaluations a ray and at {asked[last]:g} waves "
        f"{evaluations[last, 0]:.1f}; the steps' error is {off[0, 1]:.1e} and {off[last, 1]:.1e} in float64, "
        f"{off[0, 0]:.1e} and {off[last, 0]:.1e} in float32.",
        f"The reported error was above the actual one in {int((off <= reported[:-1]).sum())} of {off.size} cases.",
    ]
    rows = [
        [
            f"{one:g}",
            f"{evaluations[j, 0]:.1f}",
            *(f"{off[j, k]:.1e}" for k in range(2)),
        ]
        for j, one in enumerate(asked)
    ][::2]
    heading = ["tolerance [waves]", "evaluations per ray", "error of the steps, float32", "float64"]

    def draw(figure: Any) -> None:
        left, right = figure.subplots(1, 2)
        for k, (name, colour) in enumerate((("float32", "#b45309"), ("float64", "#0b6e99"))):
            shown = np.maximum(off[:, k], 1e-12)
            left.loglog(evaluations[:-1, k], shown, "o-", color=colour, label=f"actual, {name}")
            right.loglog(asked, shown, "o-", color=colour, label=f"actual, {name}")
            right.loglog(asked, reported[:-1, k], "s:", color=colour, markersize=4, label=f"reported, {name}")
        left.set(xlabel="evaluations a ray", ylabel="error of the Strehl ratio", title="What it costs")
        right.set(xlabel="tolerance [waves]", ylabel="error of the Strehl ratio", title="What it buys")
        left.legend(), right.legend()

    return Answer(tuple(sentences), markdown_table(heading, rows, 0), draw)


QUESTIONS: dict[str, Callable[..., Answer]] = {
    "altitude": altitude,
    "aperture": aperture,
    "look-angle": look_angle,
    "tolerance": tolerance,
}


def main() -> None:
    """Run the sweeps, and write text and picture of each answer."""
    parser = argparse.ArgumentParser(prog="scripts/questions", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(QUESTIONS)} [all of them]")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "questions", help="folder of what is written")
    parser.add_argument("--page", action="store_true", help="put the texts into docs/questions.md too")
    parser.add_argument("--quick", action="store_true", help="few rays and a coarse grid, to see how it goes")
    options = parser.parse_args()
    names = options.names or list(QUESTIONS)
    for name in names:
        if name not in QUESTIONS:
            parser.error(f"{name!r} is no question: choose among {', '.join(QUESTIONS)}")
    try:
        if options.page:  # fail before the work, not after it
            filled(PAGE, dict.fromkeys(names, ""))
    except ValueError as fault:
        parser.error(str(fault))
    options.out.mkdir(parents=True, exist_ok=True)
    for name in names:
        given: dict[str, Any] = {}
        if options.quick:
            given = {"ray_count": 512} if name == "look-angle" else {"settings": QUICK}
        answer = QUESTIONS[name](**given)
        (options.out / f"{name}.md").write_text(answer.text, encoding="utf-8")
        answer.save(options.out / f"{name}.png")
        if options.page:
            PAGE.write_text(filled(PAGE, {name: answer.text}), encoding="utf-8")
        print(f"{name}\n{answer.text}", flush=True)
    print(f"wrote {', '.join(f'{name}.md and {name}.png' for name in names)} to {options.out}")


if __name__ == "__main__":
    main()
