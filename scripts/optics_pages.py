"""Make the numbers and pictures of docs/optics-measured.md: displacement behind a cone, traced and exact; FLDI."""

import argparse
import math
import time
from pathlib import Path

import numpy as np

from aerokernels import FLDI, Camera, Disc, IndexField, RayBundle, background_displacement, bos, fldi_response, flow
from tests.imaging.cone_rays import rays_past_cone

ROOT = Path(__file__).resolve().parents[1]
LENGTH, STATION, MACH, HALF_ANGLE, WAVELENGTH = 0.05, -0.03, 2.5, math.radians(15.0), 532e-9


def cone_displacement(spacing: float, rows: int) -> dict[str, np.ndarray]:
    """Return the displacement along a column of pixels across a cone at sea level, traced and exact, by height [m].

    The camera is 1 m from the axis, the pattern 1 m behind it. Exact: the camera's own rays, refracted at the shock
    and traced through the Taylor-Maccoll flow (tests/imaging/cone_rays.py).
    """
    gas = flow.cone(MACH, HALF_ANGLE, length=LENGTH)
    field = gas.index_field(WAVELENGTH, "paper", spacing=spacing)
    pupil = Disc(1e-3, center=(-1.0, 0.0, STATION), normal=(1.0, 0.0, 0.0))
    camera = Camera(pupil, 0.1, 3.6e-3 / rows, (rows, 3), distance=2.0)
    found = background_displacement(field, camera, aperture_rays=1)
    x, tangent = camera.tangents((rows, 3))
    edge = -STATION * math.tan(gas.shock.shock_angle)
    flown = (np.abs(tangent) > -STATION * math.tan(HALF_ANGLE) + 4.0 * spacing) & (np.abs(tangent) < edge)
    direction = camera.directions(np.full(flown.sum(), x[1]), tangent[flown])
    start = np.broadcast_to(pupil.center, direction.shape)
    place, way = rays_past_cone(gas.shock, field.ambient_index, RayBundle(start, direction))
    landing = place + ((1.0 - place[:, :1]) / way[:, :1]) * way
    straight = start + (2.0 / direction[:, :1]) * direction
    exact = np.full((rows, 2), np.nan)
    exact[flown] = -camera.across(landing - straight) / camera.scene_pixel
    return {
        "height": tangent,
        "traced": found.displacement[:, 1],
        "exact": exact,
        "inside": edge - np.abs(tangent),
        "flown": flown,
    }


def transfer(instrument: FLDI, distance: float, wave_number: np.ndarray) -> np.ndarray:
    """Return the response to a sheet of sine waves at a distance from the focus, relative to their slope."""
    thickness, found = 2e-4, []
    for number in wave_number:
        step = 2.0 * np.pi / number / 32
        half = 3.0 * float(instrument.radius(distance)) + instrument.separation
        y = step * np.arange(-int(half / step) - 8, int(half / step) + 9)
        z = np.linspace(-0.75, 0.75, 25) * thickness
        bell = np.where(np.abs(z) < 0.5 * thickness, np.cos(np.pi * z / thickness) ** 4, 0.0)
        field = IndexField.from_samples(
            1e-7 * np.sin(number * y)[:, None] * bell,
            origin=(y[0], distance + z[0]),
            spacing=(step, z[1] - z[0]),
            geometry="planar",
        )
        slope = 2.0 * np.pi / instrument.wavelength * 1e-7 * 0.375 * thickness * number * instrument.separation
        found.append(float(fldi_response(field, instrument).phase) / slope)
    return np.array(found)


def main() -> None:
    """Print the tables and write the pictures."""
    parser = argparse.ArgumentParser(prog="scripts/optics_pages", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "optics")
    parser.add_argument("--quick", action="store_true", help="few pixels and wave numbers, to see that it runs")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    from matplotlib.figure import Figure

    rows = 61 if options.quick else 241
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    print("spacing [mm] | cells inside the shock | greatest error [pixels] | greatest displacement [pixels]")
    for cells in (200, 400):
        found = cone_displacement(LENGTH / cells, rows)
        error = np.abs(found["traced"] - found["exact"]).max(axis=1)
        for away in (4, 8):
            chosen = found["flown"] & (found["inside"] > away * LENGTH / cells)
            shown = np.abs(found["traced"][chosen]).max()
            print(f"{1e3 * LENGTH / cells:.3f} | {away} | {error[chosen].max():.2g} | {shown:.3g}")
    upper = found["flown"] & (found["height"] > 0.0)
    for axis, name in ((0, "along the flow"), (1, "across it")):
        left.plot(1e3 * found["height"][upper], found["traced"][upper, axis], ".", ms=3, label=name)
        left.plot(1e3 * found["height"][upper], found["exact"][upper, axis], "k-", lw=0.6)
    left.set(xlabel="height above the axis [mm]", ylabel="displacement [pixels]", ylim=(-4, 4))
    left.legend()
    right.semilogy(1e3 * found["height"][upper], error[upper])
    right.set(xlabel="height above the axis [mm]", ylabel="error [pixels]")
    figure.savefig(options.out / "cone.png", dpi=110)

    instrument = FLDI(120e-6, 6e-6, direction=(0.0, 1.0, 0.0))
    wave_number = np.geomspace(30.0, 3e4, 5 if options.quick else 25)
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for distance in (0.0, 0.005, 0.05):
        begin = time.perf_counter()
        measured, closed = transfer(instrument, distance, wave_number), instrument.transfer(wave_number, distance)
        seconds = time.perf_counter() - begin
        print(
            f"FLDI, {1e3 * distance:g} mm from the focus: greatest error {np.abs(measured - closed).max():.1e}", end=""
        )
        print(f" over three decades, {seconds:.2g} s")
        left.loglog(wave_number, np.maximum(np.abs(measured), 1e-9), ".", label=f"{1e3 * distance:g} mm")
        left.loglog(wave_number, np.maximum(np.abs(closed), 1e-9), "k-", lw=0.6)
        right.loglog(wave_number, np.maximum(np.abs(measured - closed), 1e-9), label=f"{1e3 * distance:g} mm")
    left.set(xlabel="wave number [rad / m]", ylabel="transfer function", ylim=(1e-4, 2.0))
    right.set(xlabel="wave number [rad / m]", ylabel="error")
    left.legend(title="from the focus")
    figure.savefig(options.out / "fldi.png", dpi=110)

    field = flow.cone(MACH, HALF_ANGLE, length=LENGTH).index_field(WAVELENGTH, "paper", spacing=LENGTH / 200)
    pupil = Disc(2e-3, center=(-1.0, 0.0, STATION), normal=(1.0, 0.0, 0.0))
    camera = Camera(pupil, 0.1, 8e-6, 64 if options.quick else 512, distance=2.0)
    pictures = bos(field, camera, aperture_rays=4)
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.imshow(pictures.picture, origin="lower", cmap="gray")
    left.set(xlabel="column [pixels]", ylabel="row [pixels]")
    pictures.plot(right).images[0].set_clim(0.0, 6.0)
    figure.savefig(options.out / "bos.png", dpi=110)


if __name__ == "__main__":
    main()
