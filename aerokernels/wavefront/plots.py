"""Plots of wavefronts and their image quantities on matplotlib axes."""

from typing import Any

import numpy as np

from ..display.shown import drawn_on, extent_of, is_flat, say_flat
from .data import WavefrontMap


def plot_opd(wavefront: WavefrontMap, axes: Any = None) -> Any:
    """Draw the OPD map [nm] over the pupil [mm]."""
    axes = drawn_on(axes)
    if is_flat(wavefront.opd, "m"):
        say_flat(axes)
        return axes
    half = 0.5e3 * len(wavefront.opd) * wavefront.pixel
    extent = (-half, half, -half, half)
    greatest = float(np.nanmax(np.abs(wavefront.opd))) * 1e9
    picture = axes.imshow(
        wavefront.opd * 1e9, origin="lower", extent=extent, cmap="RdBu_r", vmin=-greatest, vmax=greatest
    )
    axes.figure.colorbar(picture, ax=axes, label="OPD [nm], positive where light is delayed")
    axes.set(xlabel="x in the pupil [mm]", ylabel="y in the pupil [mm]")
    return axes


def plot_point_spread(spread: Any, axes: Any = None, decades: float = 4.0) -> Any:
    """Draw the intensity of a PointSpread over field angles [urad], logarithmic."""
    axes = drawn_on(axes)
    extent = extent_of(1e6 * spread.angle, 1e6 * spread.angle)
    shown = np.log10(np.maximum(spread.intensity, spread.peak * 10.0**-decades))
    picture = axes.imshow(shown, origin="lower", extent=extent, cmap="inferno")
    axes.figure.colorbar(picture, ax=axes, label="log10 of intensity over the perfect peak")
    axes.set(xlabel="field angle x [urad]", ylabel="field angle y [urad]")
    return axes


def plot_transfer(transfer: Any, axes: Any = None) -> Any:
    """Draw the MTF of a Transfer along both axes, beside the one of the perfect pupil."""
    axes = drawn_on(axes)
    for name, angle in (("x", 0.0), ("y", 0.5 * np.pi)):
        frequency, value = transfer.along(angle)
        axes.plot(frequency * 1e-3, np.abs(value), label=f"along {name}")
    middle = len(transfer.frequency) // 2
    axes.plot(transfer.frequency[middle:] * 1e-3, transfer.perfect[middle, middle:], "k:", label="perfect")
    axes.set(xlabel="spatial frequency [cycles / mrad]", ylabel="MTF", ylim=(0.0, 1.05))
    axes.legend()
    return axes


def plot_encircled_energy(encircled: Any, axes: Any = None) -> Any:
    """Draw an EncircledEnergy: the share of the light within an angle."""
    axes = drawn_on(axes)
    axes.plot(np.ravel(encircled.angle) * 1e6, np.ravel(encircled.energy))
    axes.set(xlabel="angle [urad]", ylabel="encircled energy", ylim=(0.0, 1.05))
    return axes


def plot_structure(structure: Any, axes: Any = None) -> Any:
    """Draw the root of a StructureFunction [nm] over the distance [mm], with its error if it is known."""
    axes = drawn_on(axes)
    root = 1e9 * np.sqrt(structure.value)
    axes.plot(1e3 * structure.separation, root)
    if np.isfinite(structure.error).all():
        high = 1e9 * np.sqrt(structure.value + structure.error)
        low = 1e9 * np.sqrt(np.maximum(structure.value - structure.error, 0.0))
        axes.fill_between(1e3 * structure.separation, low, high, alpha=0.3)
    axes.set(xlabel="distance [mm]", ylabel="root of the structure function [nm]")
    return axes
