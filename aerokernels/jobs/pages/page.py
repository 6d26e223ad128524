"""The page of a report: what was asked, answers in words, pictures, numbers, how to repeat it, details.

Everything is in one file: figures, data and script are embedded, and nothing is loaded.
"""

import base64
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from aerokernels import __version__
from aerokernels.display.canvas import color_tables
from aerokernels.display.plain_text import plain
from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import quantity_text
from aerokernels.jobs.store import to_json
from aerokernels.process.foreign_files import fault_text
from aerokernels.process.opened import OPENED

if TYPE_CHECKING:
    import jinja2

CITATION = (
    "Simulation Test of The Aerodynamic Environment of A Missile-Borne Pulsed Laser Forward Detection System "
    "at High Flight Speed"
)
Row = tuple[str, str, str, str]  # label, value with error and unit, remark, the word that explains it
# The words that pages explain.
WORDS = {
    "strehl": ("Strehl ratio", "The peak of the image of a point over the peak without flow; 1 is undisturbed."),
    "opd": (
        "OPD",
        "Optical path difference: the path of the light less that through undisturbed air. Positive where the light is "
        "delayed. Maps have the pupil's first axis to the right and its second up, as seen from ahead.",
    ),
    "boresight": ("Boresight error", "The angle by which the image of a point is shifted."),
    "jitter": ("Jitter", "The standard deviation in time of that angle."),
    "density": ("Density", "Mean density of a cell of the flow's mesh. The refractive index follows from it."),
    "rays": (
        "Rays",
        "Lines along which light goes through the flow. Where flow and pupil are symmetric, few rays stand for many.",
    ),
    "echo": ("Echo", "The pulse that comes back from the target, as the detector's voltage."),
    "range": ("Range", "Half the pulse's time of flight times the speed of light, read by the ranging method."),
    "correlation": ("Correlation", "Pearson's coefficient r of the recorded mean and the simulated waveform."),
    "error": ("±", "The value and its error contain the true value, of the same flow, in 95 of 100 cases."),
}


class Picture(Protocol):
    """What a panel shows: see `Lines` and `Raster`."""

    def spec(self, name: str) -> dict[str, Any]:
        """Return it for the page's script."""

    def static(self) -> str:
        """Return it for paper, as a data URL."""


@dataclass(frozen=True)
class Answer:
    """An answer as a sentence around one number.

    Attributes:
        before, after: The sentence's parts.
        value, error, unit: The number in large print.
        more: What explains it.
    """

    before: str
    value: str
    error: str = ""
    unit: str = ""
    after: str = ""
    more: str = ""

    @classmethod
    def of(cls, before: str, number: Quantity, after: str = "", more: str = "", limit: str = "") -> "Answer":
        """Return the answer of a number; one below its error is given by its limit, in the words `limit`, alone."""
        error = number.error or 0.0
        if error > 0.0 and error >= abs(number.value):
            text = f"≤ {abs(number.value) + error:.2g}"
            return cls(limit or before, text, "", number.unit, after, "The error is greater than the value.")
        parts = re.fullmatch(r"(\S+) \+- (\S+?)(?: (.*))?", number.text())
        if parts is None:
            return cls(before, f"{number.value:.3g}".replace("-", "−"), "", number.unit, after, more)
        return cls(before, parts[1].replace("-", "−"), parts[2], number.unit, after, more)


@dataclass(frozen=True)
class Bar:
    """A row of a panel of bars: a name, a bar or a dot with its error, and a text.

    Attributes:
        name, remark: What it is.
        text: Its value.
        share: Length of the bar [%].
        dot: Low end, place and high end of a dot with its error [%], in place of a bar.
        kind: "below" (grey), "total", or nothing.
    """

    name: str
    text: str
    share: float = 0.0
    dot: tuple[float, float, float] | None = None
    remark: str = ""
    kind: str = ""


@dataclass(frozen=True, eq=False)
class Panel:
    """A figure of the page.

    Attributes:
        name: Its id.
        title: What it shows.
        says: What is seen, in a sentence with numbers.
        alt: What it shows, for those who do not see it.
        shown: The picture; None for bars, or where it could not be drawn.
        caption: A remark below.
        tools: Controls: "air", "terms", "scale", or nothing.
        rows, mark: Bars, and a mark across them [%].
        again: Makes a second static picture, for paper.
    """

    name: str
    title: str
    says: str = ""
    alt: str = ""
    shown: Picture | None = None
    caption: str = ""
    tools: str = ""
    rows: Sequence[Bar] = ()
    mark: float | None = None
    again: Callable[[], str] | None = None


@dataclass(frozen=True, eq=False)
class Page:
    """The content of a report; texts are escaped where the page is made.

    Attributes:
        kind: "run", "sweep", "series" or "comparison".
        title: Its heading.
        asked: What was asked, as pairs of name and value.
        answers: At most three answers.
        panels: The pictures.
        numbers: Groups of numbers: a heading and rows.
        tables: Tables below: caption, columns and rows.
        remarks: What a reader must know besides the numbers: heading and text.
        alarm: Whether the numbers are not meaningful.
        scene: The scene's text, to be saved.
        repeat: Lines that repeat the job.
        details: Folded lists: heading and lines.
        words: Keys of WORDS that the page explains.
        raw: Pairs of key and value as in summary.json.
        plots: Make the data of pictures that belong to several panels, for the page's script.
    """

    kind: str
    title: str
    asked: Sequence[tuple[str, str]]
    answers: Sequence[Answer] = ()
    panels: Sequence[Panel] = ()
    numbers: Sequence[tuple[str, Sequence[Row]]] = ()
    tables: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]] = ()
    remarks: Sequence[tuple[str, str]] = ()
    alarm: bool = False
    scene: str = ""
    repeat: Sequence[str] = ()
    details: Sequence[tuple[str, Sequence[str]]] = ()
    words: Sequence[str] = ("error",)
    raw: Sequence[tuple[str, str]] = ()
    plots: Sequence[Callable[[], Mapping[str, Any]]] = ()

    def html(self) -> str:
        """Return the complete document."""
        specs: list[Mapping[str, Any]] = []
        try:
            specs += [plot() for plot in self.plots]
        except Exception:  # a report needs no script: the static pictures are shown
            specs.clear()
        is_whole = len(specs) == len(self.plots)
        panels = []
        for panel in self.panels:
            spec, pictures, says = _drawn(panel)
            if spec.get("kind"):
                specs.append(spec)
            film = len(spec.get("times", ()))
            own = {name: getattr(panel, name) for name in ("name", "title", "alt", "caption", "tools", "rows", "mark")}
            live = bool(pictures) and (bool(spec.get("kind")) or is_whole)
            panels.append({**own, "says": says, "film": film if film > 1 else 0, "is_live": live, "pictures": pictures})
        maps = {"density", "delay", "light", "value"}
        data = {"plots": specs, "colors": color_tables(maps)} if specs else {}
        template, parts = OPENED.once("template of reports", _template)
        content = {name: getattr(self, name) for name in self.__dataclass_fields__ if name not in ("panels", "words")}
        tables = [
            (caption, columns, [[_typeset(cell) for cell in row] for row in rows])
            for caption, columns, rows in self.tables
        ]
        content |= {
            "panels": panels,
            "tables": tables,
            "words": [(word, *WORDS[word]) for word in self.words],
            "version": __version__,
            "has_budget": any(panel.name == "budget" for panel in self.panels),
        }
        plots = _script_json(data) if data else ""
        return plain(template.render(page=content, plots=plots, citation=CITATION, **parts))


def _drawn(panel: Panel) -> tuple[dict[str, Any], list[str], str]:
    """Return a panel's data for the script, its static pictures, and what it says: why, if it cannot be drawn."""
    if panel.shown is None:
        return {}, [], panel.says
    try:
        pictures = [panel.shown.static(), *([panel.again()] if panel.again is not None else [])]
        return panel.shown.spec(panel.name), pictures, panel.says
    except Exception as fault:  # a report needs no picture
        return {}, [], f"No picture: {fault_text(fault, None)}"


def shown(number: Quantity, factor: float = 1.0, unit: str = "", signed: bool = False) -> str:
    """Return a quantity with its error as pages write it: "21.53 ± 0.53 nm"."""
    return _typeset(quantity_text(number, factor, unit, signed))


def _typeset(text: str) -> str:
    """Return the text of a number with "±", and with a minus sign in place of a hyphen."""
    text = text.replace("+-", "±")
    return re.sub(r"(?<![\w.])-(?=\d)|(?<=e)-(?=\d)", "−", text)


def _script_json(data: Mapping[str, Any]) -> str:
    """Return data as JSON that may stand in a script element: nothing in it ends the element."""
    text = json.dumps(to_json(data), separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _template() -> "tuple[jinja2.Template, dict[str, Any]]":
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aerokernels.jobs.pages"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["link"] = _link
    read = environment.loader.get_source if environment.loader is not None else None
    assert read is not None
    parts = {name: read(environment, f"page.{name}")[0] for name in ("css", "js")}
    return environment.get_template("page.html"), parts


def _link(text: str) -> str:
    """Return a text as a data URL to save."""
    return f"data:text/plain;base64,{base64.b64encode(text.encode()).decode('ascii')}"
