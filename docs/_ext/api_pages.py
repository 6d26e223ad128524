"""Pages of the Python reference: one a package, each public name once, with the directive that takes its docstring."""

import enum
import importlib
import inspect
from types import ModuleType
from typing import Any

# Page: its title, one sentence, and the package whose `__all__` it shows beside the top-level names that live there.
PACKAGES = {
    "flow": ("Flow", "Density fields: exact flows, shipped and own CFD files, gas relations, refractivity."),
    "medium": ("Medium", "The refractive index that rays see, on grids and meshes, and bodies in it."),
    "rays": ("Pupils and rays", "Where rays start, where they point, and what share of the light each one has."),
    "tracing": ("Tracing", "Rays through a field: one entry for every method, engine, device and precision."),
    "strehl_estimate": ("Strehl ratio", "The Strehl ratio of a field seen through a pupil, with an error bar."),
    "wavefronts": ("Wavefront", "Maps of the optical path difference over a pupil and what they make of the light."),
    "zernike": ("Zernike polynomials", "The polynomials and their indices."),
    "waves": ("Waves", "Wave optics beside the rays: split-step propagation, and when rays are not enough."),
    "benches": ("Schlieren", "Pictures of a schlieren bench, and what is read off them."),
    "imaging": ("Imaging", "Pictures through a flow, and background-oriented schlieren."),
    "fldi": ("FLDI", "A focused laser differential interferometer: instrument, transfer function, response."),
    "series": ("Series", "Snapshots of a flow in time, their statistics, and maps over look angles."),
    "lidar": ("Echo and range", "The echo of a pulsed laser rangefinder, its detector chain, and the range it reads."),
    "scene": ("Scenes", "What a user describes in a TOML file."),
    "jobs": ("Jobs", "Whole jobs: a run, a sweep, and what they return."),
    "compare": ("Comparing", "Recorded waveforms against simulated ones."),
    "hardware": ("Hardware", "Recorded echoes on disk."),
}
# Names without an `__all__` that the pages refer to, by page.
MORE = {
    "hardware": ["hardware.store.EchoStore", "hardware.export.export_store"],
    "compare": [],
    "strehl_estimate": [],
    "jobs": [],
}
# Names of a package that are there for other packages, not for users.
INNER = {
    "wavefronts": {"check_metres", "check_terms", "check_wavefront", "map_points", "mean_phasor", "weighted_mean"},
    "rays": {"as_unit_vector", "as_vector", "transverse_axes", "unit_disc_samples"},
}
# Where a top-level name is shown that lives in a module without a page of its own.
SHOWN = {
    "strehl": "strehl_estimate",
    "sensor": "imaging",
    "jobs.run": "jobs",
    "jobs.sweeps.run": "jobs",
    "pupils": "rays",
    "tracing.trace": "tracing",
}


def _top_level() -> dict[str, list[str]]:
    """Top-level public names by page, in their order."""
    import aerokernels

    found: dict[str, list[str]] = {}
    for name in aerokernels.__all__:
        home = aerokernels._MODULE_OF[name]
        if home:
            found.setdefault(SHOWN.get(home, home), []).append(name)
    return found


def shown_names() -> dict[str, list[str]]:
    """Full public names by page, each once: what the reference documents."""
    import aerokernels

    top = _top_level()
    claimed = {id(getattr(aerokernels, name)) for names in top.values() for name in names}
    shown: dict[str, list[str]] = {}
    for page in (*PACKAGES, *(page for page in top if page not in PACKAGES)):
        names = [f"aerokernels.{name}" for name in top.get(page, [])]
        module = _module(page)
        if module is not None and page != "jobs":
            for name in sorted(getattr(module, "__all__", []), key=lambda name: (not name[0].isupper(), name.lower())):
                thing = getattr(module, name)
                if id(thing) in claimed or name in INNER.get(page, ()):
                    continue
                if not isinstance(thing, (int, float, str, tuple, dict)):
                    claimed.add(id(thing))
                names.append(f"aerokernels.{page}.{name}")
        if page == "strehl_estimate":
            names.append("aerokernels.focus.strehl")
        shown[page] = names + [f"aerokernels.{name}" for name in MORE.get(page, []) if _exists(name)]
    return shown


def _heading(page: str) -> tuple[str, str]:
    """Title and sentence of a page; those of a package that has none here are made from its docstring."""
    if page in PACKAGES:
        return PACKAGES[page]
    words = (_module(page).__doc__ or "").strip().split("\n\n")[0]
    return page.rpartition(".")[2].replace("_", " ").capitalize(), " ".join(words.split())


def pages() -> dict[str, str]:
    """File name and text of each page, the index among them."""
    texts = {}
    rows = []
    for page, names in shown_names().items():
        title, words = _heading(page)
        directives = "\n".join(_directive(name) for name in names)
        texts[f"{page}.md"] = f"# {title}\n\n{words}\n\n```{{eval-rst}}\n{directives}```\n"
        short = ", ".join("`" + name.rpartition(".")[2] + "`" for name in names)
        rows.append(f"| [{title}](api/{page}.md) | {short} |")
    toctree = "\n".join(f"api/{page}" for page in texts).replace(".md", "")
    texts["../python.md"] = (
        "# Python\n\nEvery public name, from its docstring. [Public names](../api.md) says in a sentence what each top-level one is"
        " for.\n\n| Page | Names |\n|---|---|\n" + "\n".join(rows) + f"\n\n```{{toctree}}\n:hidden:\n\n{toctree}\n```\n"
    )
    return texts


def _module(page: str) -> ModuleType | None:
    try:
        return importlib.import_module(f"aerokernels.{page}")
    except ModuleNotFoundError:
        return None


def _exists(name: str) -> bool:
    home, _, last = name.rpartition(".")
    return hasattr(importlib.import_module(f"aerokernels.{home}"), last)


def resolve(name: str) -> Any:
    """The object of a full public name."""
    home, _, last = name.rpartition(".")
    return getattr(importlib.import_module(home), last)


def _directive(name: str) -> str:
    thing = resolve(name)
    if inspect.isclass(thing) and issubclass(thing, enum.Enum):
        return f".. autoclass:: {name}\n   :members:\n   :undoc-members:\n"
    if inspect.isclass(thing):
        return f".. autoclass:: {name}\n   :members:\n"
    if callable(thing):
        return f".. autofunction:: {name}\n"
    value = repr(thing)
    shown = f"   :value: {value}\n" if len(value) <= 70 else ""
    return f".. py:data:: {name}\n   :type: {type(thing).__name__}\n{shown}"
