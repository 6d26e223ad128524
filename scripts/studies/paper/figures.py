"""Draw the paper's Figures 5 to 8 from this package's results."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..report import saved_figure
from .cases import Case, Shadow
from .printed import MACH, SIMULATED, TABLE_3

COLOUR = {0: "#1f2933", 2: "#0b6e99", 3: "#2f9e6e", 4: "#c2410c"}
TEST, MODEL = "#c2410c", "#0b6e99"


def words(mach: int) -> str:
    """Label of a Mach number in legends."""
    return f"Mach {mach}" if mach else "no flow"


@contextmanager
def _picture(path: Path, width: float, height: float, rows: int, columns: int, **layout) -> Iterator[np.ndarray]:
    """Panels of a figure in the docs' style, shape (rows, columns); saved at the end."""
    with saved_figure(path, width, height) as figure:
        yield figure.subplots(rows, columns, squeeze=False, **layout)


def _show(axes, shadow: Shadow, half: str = "both") -> None:
    """Draw a picture, x downstream from the nose tip; `half`: "both", "upper" or "lower"."""
    image, outline = shadow.image, shadow.outline
    margin = 500.0 * (image.vertical[1] - image.vertical[0])  # half a pixel [mm]
    kept = {"both": slice(None), "upper": image.vertical > 0.0, "lower": image.vertical < 0.0}[half]
    y = 1e3 * image.vertical[kept]
    x = -1e3 * image.horizontal[::-1]
    extent = (x[0] - margin, x[-1] + margin, y[0] - margin, y[-1] + margin)
    axes.imshow(
        image.intensity[kept, ::-1], origin="lower", extent=extent, cmap="gray", vmin=0.0, vmax=1.0, aspect="equal"
    )
    axes.grid(False)
    axes.fill(-1e3 * outline[:, 0], 1e3 * outline[:, 1], facecolor="#5b6470", linewidth=0.0)
    axes.set_xlim(-12.0, 129.0)


def draw_figure5(shadows: dict[int, Shadow], path: Path) -> None:
    """Draw front and rear of the model at each Mach number, as the paper shows them, with one setting of the bench."""
    views = (("front", -8.0, 48.0, 32.0), ("rear", 38.0, 128.0, 72.0))
    ratios = [2.0 * half / (high - low) for _, low, high, half in views]
    with _picture(path, 11.4, 10.4, 2, len(shadows), height_ratios=ratios) as panels:
        for row, (part, low, high, half) in zip(panels, views, strict=True):
            for axes, (mach, shadow) in zip(row, shadows.items(), strict=True):
                _show(axes, shadow)
                axes.set(xlim=(low, high), ylim=(-half, half), title=f"Mach {mach}, {part}")
                axes.set_xlabel("downstream from the nose tip [mm]")
            row[0].set_ylabel("y [mm]")


def draw_figure6(upper: dict[int, Shadow], lower: dict[int, Shadow], path: Path) -> None:
    """Draw atmospheric density above and tunnel density below, as the paper does, each with its own exposure."""
    with _picture(path, 12.6, 5.4, 1, len(upper), sharey=True) as panels:
        for axes, mach in zip(panels[0], upper, strict=True):
            _show(axes, upper[mach], "upper")
            _show(axes, lower[mach], "lower")
            axes.set(ylim=(-80.0, 80.0), xlabel="downstream from the nose tip [mm]", title=f"Mach {mach}")
            axes.axhline(0.0, color="white", linewidth=0.8)
            for y, label in ((70.0, "atmospheric density"), (-76.0, "tunnel density")):
                axes.text(-9.0, y, label, color="white", fontsize=9.0, backgroundcolor="#1f293399")
        panels[0][0].set_ylabel("y [mm]")


def draw_figure7(cases: dict[str, dict[int, Case]], path: Path) -> None:
    """Draw recorded echoes by Mach number, and the rising edge at the threshold enlarged."""
    with _picture(path, 12.6, 5.0, 1, len(cases), sharey=True) as panels:
        for axes, (density, by_mach) in zip(panels[0], cases.items(), strict=True):
            inset = axes.inset_axes((0.60, 0.34, 0.385, 0.42))
            crossings = []
            for mach, case in by_mach.items():
                time, voltage = 1e9 * case.recorded.time, case.recorded.voltage
                for place, width in ((axes, 1.5), (inset, 1.3)):
                    place.plot(time, voltage, color=COLOUR[mach], linewidth=width, label=words(mach))
                rise = int(np.argmax(voltage >= 1.0))
                crossings.append(np.interp(1.0, voltage[rise - 1 : rise + 1], time[rise - 1 : rise + 1]))
            middle = 0.5 * (min(crossings) + max(crossings))
            reach = max(0.6, 0.75 * (max(crossings) - min(crossings)))
            inset.set(xlim=(middle - reach, middle + reach), ylim=(0.85, 1.15))
            inset.axhline(1.0, color="#8a94a0", linewidth=0.9, linestyle="--")
            inset.tick_params(labelsize=8.0)
            inset.set_title("rising edge at 1 V", fontsize=9.0)
            axes.axhline(1.0, color="#8a94a0", linewidth=0.9, linestyle="--")
            axes.set(
                xlim=(-2.0, 38.0),
                ylim=(-0.1, 2.35),
                xlabel="time after the pulse's peak left [ns]",
                title=f"Echoes at {density} density",
            )
            axes.legend(loc="upper right", ncols=4, fontsize=9.0, columnspacing=1.2, handlelength=1.4)
        panels[0][0].set_ylabel("recorded voltage [V]")


def draw_figure8(cases: dict[str, dict[int, Case]], path: Path) -> None:
    """Draw the recorded echo at tunnel density, the simulated one at atmospheric density, and the paper's peaks."""
    with _picture(path, 12.6, 7.6, 2, 2, sharex=True, sharey=True) as panels:
        for axes, mach in zip(panels.ravel(), MACH, strict=True):
            test, model = cases["tunnel"][mach].recorded, cases["atmospheric"][mach].recorded
            axes.plot(1e9 * test.time, test.voltage, color=TEST, linewidth=1.5, label="recorded, tunnel density")
            axes.plot(
                1e9 * model.time,
                model.clean_voltage,
                color=MODEL,
                linewidth=1.5,
                label="simulated, atmospheric density",
            )
            for peak, colour, label in (
                (TABLE_3[mach], TEST, "paper's test peak"),
                (SIMULATED[mach], MODEL, "paper's simulated peak"),
            ):
                axes.axhline(peak, color=colour, linewidth=1.0, linestyle=":", label=label)
            axes.set(xlim=(-2.0, 38.0), ylim=(-0.1, 2.35), title=words(mach).capitalize().replace("mach", "Mach"))
        panels[0][0].legend(loc="center right", fontsize=8.5)
        for axes in panels[-1]:
            axes.set_xlabel("time after the pulse's peak left [ns]")
        for axes in panels[:, 0]:
            axes.set_ylabel("voltage [V]")
