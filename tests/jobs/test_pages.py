"""Reports stand alone, show the data that they were given, escape texts of strangers; their script works."""

import html
import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from aerokernels.display.figures import Axis, Line, Lines, Raster, packed
from aerokernels.display.quantities import Quantity
from aerokernels.jobs.pages.page import Answer, Bar, Page, Panel

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: the script of reports is not tested")


@pytest.fixture
def run(small_run) -> Path:
    """The report of a shipped scene."""
    return small_run[1]


def opened(path: Path, script: str = "") -> str:
    """Return the document of a page after its script has run, and `script` after it."""
    page = path.read_text(encoding="utf-8")
    if script:
        page = page.replace("</body>", f"<script>{script}</script></body>")
    place = path.with_name("opened.html")
    place.write_text(page, encoding="utf-8")
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000"]
    command += ["--enable-logging=stderr", "--window-size=1200,2000", "--dump-dom", place.as_uri()]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=120)
    assert "Uncaught" not in done.stderr, [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout


def made(page: Page, tmp_path: Path) -> Path:
    path = tmp_path / "report.html"
    path.write_text(page.html(), encoding="utf-8")
    return path


def test_a_report_loads_nothing_and_is_small(run: Path):
    page = (run / "report.html").read_text(encoding="utf-8")
    assert len(page) < 1_500_000
    assert not re.search(
        r"(src|href)\s*=\s*['\"]?(?!data:|#)[\w/]", re.sub("<script>.*?</script>", "", page, flags=re.S)
    )
    assert "@import" not in page and "http://" not in re.sub(r"data:[^\"]*|http://www.w3.org/2000/svg", "", page)


def test_answers_are_those_of_the_summary(run: Path):
    """The three answers in words, from summary.json; no key of summary.json outside the raw values."""
    page = (run / "report.html").read_text(encoding="utf-8")
    summary = json.loads((run / "summary.json").read_text())
    big = re.findall(r"<b>(.*?)<small>(.*?)</small>", page.replace("\n", " "))
    assert float(big[0][0]) == pytest.approx(100.0 * (1.0 - summary["strehl"]), rel=0.01)
    assert float(big[1][0]) == pytest.approx(1e9 * summary["opd_rms_m"], rel=0.01)
    assert float(big[2][0]) == pytest.approx(1e3 * abs(summary["range_error_m"]), rel=0.01)
    assert [re.search(r"\S+$", unit.strip())[0] for _, unit in big] == ["%", "nm", "mm"]  # type: ignore[index]
    body = page[: page.index("Raw values")]
    for key in ("opd_rms_m", "echo_peak_v", "averages_lacking", "range_uncertainty_m"):
        assert key not in re.sub(r"<script.*?</script>|<pre>.*?</pre>", "", body, flags=re.S), key


@browser
def test_every_plot_of_a_run_is_drawn_and_terms_can_be_removed(run: Path):
    """The script's own numbers against the run's: OPD with and without tilt and focus, and the peak of the focus."""
    told = "document.title = JSON.stringify(TOLD)"
    script = (
        "const w = report.wavefront, first = {rms: w.state.rms, peak: w.state.psf[80 * 161 + 80]};"
        "for (const b of document.querySelectorAll('[data-term]'))"
        " b.checked = ['tilt', 'focus'].includes(b.dataset.term);"
        "w.refresh();"
        + told.replace(
            "TOLD",
            "{...first, left: w.state.rms, plots: document.querySelectorAll('.plot').length,"
            "empty: [...document.querySelectorAll('.plot svg')].filter(s => !s.querySelector('.axis path')).length}",
        )
    )
    told_back = json.loads(html.unescape(re.search("<title>(.*?)</title>", opened(run / "report.html", script))[1]))  # type: ignore[index]
    summary = json.loads((run / "summary.json").read_text())
    import xarray

    with xarray.open_dataset(run / "result.nc") as data:
        rms, left = (float(data[name].attrs["rms_m"]) for name in ("opd", "opd_without_focus"))
    assert told_back["plots"] >= 8 and told_back["empty"] == 0
    assert told_back["rms"] == pytest.approx(1e9 * rms, rel=1e-3)
    assert told_back["left"] == pytest.approx(1e9 * left, rel=3e-2)
    assert told_back["peak"] == pytest.approx(summary["strehl"], abs=2e-3)


@browser
def test_a_pointer_reads_values(tmp_path: Path):
    """Lines with errors, a film and a heat map with names: what is read is what was given."""
    x = np.linspace(0.0, 10.0, 11)
    line = Lines(Axis("x [mm]", unit="mm"), Axis("y [nm]", unit="nm"), [Line(x, 2.0 * x, "twice", error=0.1 * x)])
    frames = np.stack([np.arange(12.0).reshape(3, 4), np.full((3, 4), 7.0)])
    ends = (0.0, 4.0), (0.0, 3.0)
    film = Raster(Axis("x", ends[0]), Axis("y", ends[1]), frames, Axis("z", (0.0, 11.0)), times=("one", "two"))
    hole = np.array([[1.0, np.nan], [3.0, 4.0]])
    named = Raster(
        Axis("a", names=("left", "right")), Axis("b", names=("low", "high")), hole[None], Axis("z"), even=False
    )
    panels = [Panel(name, name, shown=shown) for name, shown in (("line", line), ("film", film), ("map", named))]
    script = """
    const at = (p, u, v) => p.show(p.left + u * p.w, p.top + (1 - v) * p.h);
    const read = (id, u, v) => { at(report[id], u, v); return report[id].read.textContent; };
    const out = [read("line", 0.5, 0.5), read("film", 0.9, 0.1), read("map", 0.9, 0.1), read("map", 0.1, 0.9)];
    const slider = document.querySelector("[data-film]"); slider.value = 1; slider.dispatchEvent(new Event("input"));
    out.push(read("film", 0.1, 0.9), document.querySelector("#film .says").textContent);
    document.title = JSON.stringify(out);"""
    page = made(Page("run", "Trial", [("Date", "today")], panels=panels), tmp_path)
    told = json.loads(html.unescape(re.search("<title>(.*?)</title>", opened(page, script))[1]))  # type: ignore[index]
    assert told[0].startswith("5.000 mm: 10.00 ± 0.5000 nm twice")
    assert told[1].endswith(": 3.000") and told[2].endswith("no value") and told[3].endswith(": 3.000")
    assert told[4].endswith(": 7.000") and told[5] == "two"


def test_what_strangers_wrote_stays_text():
    evil = '</script><img src=x onerror=alert(1)>"'
    line = Lines(Axis(evil), Axis(evil), [Line([0.0, 1.0], [0.0, 1.0], evil)])
    page = Page(
        "run",
        evil,
        [(evil, evil)],
        [Answer(evil, evil, evil, evil, evil, evil)],
        [Panel("one", evil, evil, evil, line, evil), Panel("two", evil, rows=[Bar(evil, evil, remark=evil)])],
        [(evil, [(evil, evil, evil, "")])],
        [(evil, [evil], [[evil]])],
        remarks=[(evil, evil)],
        scene=evil,
        repeat=[evil],
        details=[(evil, [evil])],
        raw=[(evil, evil)],
    ).html()
    assert "<img src=x" not in page and page.count("</script>") == 2
    assert "\x1b" not in Page("run", "a\x1b[31mb", []).html()


def test_a_number_below_its_error_is_a_limit():
    small = Answer.of("The flow costs", Quantity(0.1, 0.4, "%"), "of the peak.", "Because.", "At most")
    assert (small.before, small.value, small.error) == ("At most", "≤ 0.5", "") and "Because" not in small.more
    known = Answer.of("The flow costs", Quantity(2.214, 0.11, "%"), "of the peak.")
    assert (known.value, known.error, known.unit) == ("2.21", "0.11", "%")
    assert Answer.of("x", Quantity(-3.0, math.nan, "mm")).value == "−3"


def test_numbers_survive_their_packing():
    import base64

    values = np.array([[1.0, -2.0, np.nan], [0.5, np.inf, 3.0]])
    told = packed(values)
    whole = np.frombuffer(base64.b64decode(told["b64"]), "<u2").reshape(told["shape"])
    back = np.where(whole > 0, told["low"] + (whole - 1.0) * told["step"], np.nan)
    known = np.isfinite(values)
    np.testing.assert_allclose(back[known], values[known], atol=told["step"])
    assert np.isnan(back[~known]).all()
    assert packed(np.full(3, np.nan))["b64"] == base64.b64encode(bytes(6)).decode()


def test_a_picture_that_cannot_be_drawn_is_said(tmp_path: Path):
    class Broken:
        def spec(self, name: str) -> dict:
            raise ValueError("no numbers")

        def static(self) -> str:
            raise ValueError("no numbers")

    line = Lines(Axis("x"), Axis("y"), [Line([0.0, 1.0], [0.0, 1.0])], band=math.nan)
    odd = Page("run", "Trial", [], panels=[Panel("odd", "Odd", shown=line)]).html()
    assert '"band":null' in odd
    lost = Page("run", "Trial", [], panels=[Panel("one", "One", shown=line)], plots=[lambda: {}["data"]]).html()
    assert "<img" in lost
    page = Page("run", "Trial", [], panels=[Panel("bad", "Bad", shown=Broken())]).html()
    assert re.search("No picture: .*no numbers", page) and "data-plot" not in page
