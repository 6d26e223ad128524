"""The arrays of a store of maps: made empty for all snapshots of a series, and longer for a series that has grown."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray

MAPS = {
    "opd": ("f8", "m", "optical path difference, terms removed"),
    "valid": ("?", "1", "whether the ray came through"),
}
VALUES = {
    "strehl": ("1", "Strehl ratio of opd"),
    "boresight_x": ("rad", "tilt of the wavefront along x"),
    "boresight_y": ("rad", "tilt of the wavefront along y"),
    "piston": ("m", "mean optical path difference"),
    "opd_rms": ("m", "rms of the optical path difference, mean and tilt removed"),
    "opd_rms_with_tilt": ("m", "rms of the optical path difference, mean removed"),
}
OTHERS = {
    "error": ("m", "error of opd in a pixel, terms removed; it covers the truth in 95 of 100 pixels"),
    "known": ("1", "share of the pupil whose rays came through; the rest is in no number"),
    "traced": ("1", "1 where the snapshot was traced in full, 0 on straight lines"),
    "slope": ("1", "mean square of the wavefront's slopes"),
    "probe": ("m", "bending's part of opd where it was measured, rms"),
}
# What a finished store has of each snapshot, with units and meanings.
NUMBERS = {
    **VALUES,
    **{
        f"{name}_error": (units, f"error of {name}; it covers the truth in 95 of 100 cases")
        for name, (units, _) in VALUES.items()
    },
    **OTHERS,
}
# What is kept of each snapshot: errors by the model, NaN where they were not computed, and by the pixels.
KEPT = (*VALUES, *OTHERS, *(f"{name}_{cause}" for name in VALUES for cause in ("model", "pixels")))


def make_arrays(path: Path, template: "xarray.Dataset") -> None:
    """Make a store with coordinates, weights and attributes of `template`, and with empty maps and numbers."""
    import zarr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        template.to_zarr(path, mode="w", consolidated=False)
    group = zarr.open_group(str(path), mode="r+")
    dims = ("time", "y", "x")
    times, *sides = (template.sizes[name] for name in dims)
    numbers = {name: ("f8", *told) for name, told in NUMBERS.items()}
    for name, (kind, units, words) in {**MAPS, **numbers}.items():
        is_map = name in MAPS
        group.create_array(
            name,
            shape=(times, *sides) if is_map else (times,),
            chunks=(1, *sides) if is_map else (times,),
            dtype=np.dtype(kind),
            fill_value=np.nan if kind == "f8" else False,
            dimension_names=dims if is_map else dims[:1],
            attributes={"units": units, "long_name": words},
        )
    consolidate(path)


def lengthen_arrays(path: Path, template: "xarray.Dataset") -> None:
    """Give a store the times of `template`, of which it has the first; its maps and numbers stay."""
    import zarr

    group = zarr.open_group(str(path), mode="r+")
    for name in ("time", *MAPS, *NUMBERS):
        array = group[name]
        array.resize((template.sizes["time"], *array.shape[1:]))
        if name == "time":
            array[:] = template["time"].values
    group.attrs["provenance"] = template.attrs["provenance"]
    consolidate(path)


def consolidate(path: Path) -> None:
    """Collect the metadata of all arrays of a store in one place, where xarray looks first."""
    import zarr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # consolidated metadata are not part of the Zarr 3 specification
        zarr.consolidate_metadata(str(path))
