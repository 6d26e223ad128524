"""Texts of users and files in figures: none is read as a formula, which "A_$_B^$" is not."""

from pathlib import Path

import numpy as np
import xarray

from aerokernels.jobs.figure_layout import house_style, plain_decades, styled_figure
from aerokernels.jobs.recorded import RecordedEcho

from .echoes_on_file import TIME, pulse, write_store
from .test_comparison import make_run

TEXT = "A_$_B^$"


def test_labels_of_echoes_and_names_of_scenes_are_texts(tmp_path: Path, command_line):
    """The comparison ended in Matplotlib's ParseSyntaxException, and nothing was written."""
    make_run(tmp_path / TEXT, 3, 2.0)
    label = (("mach", "3"), ("who", TEXT))
    write_store(tmp_path / "s.sqlite", [RecordedEcho(label, TIME, pulse(TIME, peak)) for peak in (1.9, 2.0, 2.1)])
    done = command_line("compare", "s.sqlite", f"who={TEXT}={TEXT}", "--out", "cmp")
    assert done.returncode == 0, done.stderr
    assert TEXT in done.stdout and (tmp_path / "cmp" / "compare.png").is_file()


def test_the_name_of_a_flow_file_is_a_text(tmp_path: Path, command_line):
    axis = np.linspace(-0.01, 0.01, 8)
    places = {"z": ("z", axis, {"units": "m"}), "y": ("y", axis, {"units": "m"})}
    data = xarray.Dataset({"rho": (("y", "z"), np.full((8, 8), 1.2), {"units": "kg/m3"})}, places)
    data.to_netcdf(tmp_path / f"{TEXT}.nc", engine="h5netcdf")
    done = command_line("fields", f"{TEXT}.nc", "--picture", "f.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "f.png").stat().st_size > 1000


def test_logarithmic_axes_need_no_formulas():
    with styled_figure(4.0, 3.0) as figure:
        left, right = figure.subplots(1, 2)
        left.loglog([1.0, 1e5], [1e-7, 3.0])
        right.loglog([2.0, 7.0], [1.0, 2.0])  # within a decade minor ticks have labels
        for axes in (left, right):
            plain_decades(axes)
    with house_style():
        figure.canvas.draw()
    labels = [
        label.get_text()
        for axes in (left, right)
        for axis in (axes.xaxis, axes.yaxis)
        for label in (*axis.get_ticklabels(), *axis.get_ticklabels(minor=True))
    ]
    assert sum(map(bool, labels)) > 8 and not any("$" in label for label in labels)
