"""Echoes with known peaks and times, and every kind of file that holds them."""

import csv
from pathlib import Path

import numpy as np
import xarray

from aerokernels.hardware.frames import EchoFrame
from aerokernels.hardware.store import EchoStore
from aerokernels.jobs.recorded import RecordedEcho

C, TAU, DISTANCE, PERIOD = 299_792_458.0, 3e-9, 3.0, 250e-12
ARRIVAL = 2.0 * DISTANCE / C
TIME = np.arange(200) * PERIOD
PEAKS = {0: 2.0, 3: 1.8}
LABELS = {mach: (("mach", str(mach)),) for mach in PEAKS}


def pulse(time, peak=2.0, late=0.0):
    return peak * np.exp(-(((time - ARRIVAL - late) / TAU) ** 2))


def noisy(count: int, noise: float, late: float = 0.0, seed: int = 1) -> list[RecordedEcho]:
    random = np.random.default_rng(seed)
    return [
        RecordedEcho(LABELS[mach], TIME, pulse(TIME, peak, late) + noise * random.standard_normal(TIME.size))
        for mach, peak in PEAKS.items()
        for _ in range(count)
    ]


def write_store(path: Path, echoes: list[RecordedEcho]) -> Path:
    with EchoStore(path) as store:
        for number, echo in enumerate(echoes):
            if number == 0 or echo.label != echoes[number - 1].label:
                store.begin_recording("test", "frames", dict(echo.label))
            counts = np.rint(echo.voltage / 1e-4).astype(np.int16)
            store.add(EchoFrame(number, 1000 * number, round(PERIOD * 1e12), 1e-4, 0.0, counts), number)
        store.commit()
    return path


def write_rows(path: Path, echoes: list[RecordedEcho]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["sequence", "label_mach", "sample_period_s", *(f"voltage_{k}_v" for k in range(TIME.size))])
        for number, echo in enumerate(echoes):
            writer.writerow([number, echo.label[0][1], PERIOD, *echo.voltage])
    return path


def write_columns(path: Path, echoes: list[RecordedEcho]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", *(f"mach={echo.label[0][1]}" for echo in echoes)])
        writer.writerows(zip(TIME, *(echo.voltage for echo in echoes), strict=True))
    return path


def write_netcdf(path: Path, echoes: list[RecordedEcho]) -> Path:
    volts = np.full((len(echoes), TIME.size + 3), np.nan)
    volts[:, : TIME.size] = [echo.voltage for echo in echoes]
    xarray.Dataset(
        {
            "voltage": (("echo", "sample"), volts),
            "sample_period": ("echo", np.full(len(echoes), PERIOD)),
            "first_sample_time": ("echo", np.zeros(len(echoes))),
            "label_mach": ("echo", [echo.label[0][1] for echo in echoes]),
        }
    ).to_netcdf(path, engine="h5netcdf")
    return path


WRITERS = {"e.sqlite": write_store, "rows.csv": write_rows, "columns.csv": write_columns, "e.nc": write_netcdf}
