"""`aerokernels compare`: compare recorded echoes with simulated runs."""

from pathlib import Path
from typing import Annotated

import typer


def compare(
    store: Annotated[
        Path,
        typer.Argument(metavar="STORE", help="The recorder's store, or a CSV or NetCDF file of recorded waveforms."),
    ],
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...",
            help="Folders of finished runs. A label mach=3 uses the run at Mach 3, or DIR if given as mach=3=DIR.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for report.html, compare.csv, compare.png, compare.nc and summary.json.")
    ] = None,
    align: Annotated[
        str,
        typer.Option(
            help="Trigger offset: none (times as recorded), each (measured on each label), or a label such as mach=0 "
            "(measured on that label, applied to all)."
        ),
    ] = "none",
    trigger_offset: Annotated[
        str, typer.Option(help="Known trigger offset: time by which the recorded times are late, such as 2.5 ns.")
    ] = "0 s",
    voltage_offset: Annotated[
        str, typer.Option(help="Known offset of the recorded voltages, which is subtracted, such as 12 mV.")
    ] = "0 V",
    threshold: Annotated[str | None, typer.Option(help="Level of the leading edge [default: the run's].")] = None,
    ranged: Annotated[int, typer.Option(help="Greatest number of echoes per label that are ranged one by one.")] = 300,
) -> None:
    """Compare recorded echoes with simulated ones.

    Label by label: peaks, relative errors, correlation, ranges.
    """
    from aerokernels.commands._output import note, output, say, warn
    from aerokernels.commands._progress import shown_progress
    from aerokernels.commands._table import print_table
    from aerokernels.inputs.units import quantity
    from aerokernels.jobs.comparison import CompareOptions, compare_recording
    from aerokernels.jobs.comparison_report import TABLES, write_comparison
    from aerokernels.jobs.recorded import label_text
    from aerokernels.jobs.run_folder import read_run
    from aerokernels.jobs.store import check_output_folder

    options = CompareOptions(
        align=align,
        trigger_offset=quantity(trigger_offset, "time"),
        voltage_offset=quantity(voltage_offset, "voltage"),
        threshold=None if threshold is None else quantity(threshold, "voltage"),
        ranged_count=ranged,
    )
    folders = [read_run(text) for text in runs]
    if out is not None:
        check_output_folder(out)
    with shown_progress("compare") as progress:
        found = compare_recording(store, folders, options, progress)
        files = [] if out is None else write_comparison(found, out)
    for make in TABLES:
        title, columns, rows = make(found)
        print_table(title, columns, rows)
    for text in found.warnings:
        warn(f"warning: {text}")
    unfit = sum(one.unfit_count for one in found.labels)
    if unfit:
        note(f"skipped {unfit} echoes with too few samples or without a sample period")
    if found.left_out:
        (note if output.as_json else say)(f"labels without a run: {', '.join(map(label_text, found.left_out))}")
    if files:
        note(f"wrote {', '.join(files)} to {out}")
