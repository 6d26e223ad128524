"""Compute one case of a sweep, and cache stages that later cases of the same process can reuse.

A case is a run without its figures: flow, index, Strehl ratio, echo, range. A stage is reused if the keys on which it
depends are unchanged: the flow depends on its own keys, the index field on [flow] and [grid], the Strehl ratio also on
the pupil, [strehl] and [trace]. Cases that share a flow are traced through one grid, which covers the widest view among
them, so that a tilt of the target does not require a new grid.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from aerokernels import __version__
from aerokernels.flow.series import on_known_geometry
from aerokernels.focus import StrehlEstimate
from aerokernels.jobs.run import run_stages, scene_strehl
from aerokernels.jobs.run_files import RunResult
from aerokernels.jobs.store import to_json
from aerokernels.medium import IndexField
from aerokernels.prepare import Prepared, prepare_field, view_extent, view_radius
from aerokernels.process.opened import OPENED
from aerokernels.scene import Scene

CACHED = 2  # number of latest flows, index fields and Strehl ratios that a process caches
_INDEX_KEYS = ("wavelength", "relation", "gladstone_dale")  # keys of [flow] that change the index but not the flow


@dataclass(frozen=True)
class Case:
    """A case as it is sent to a worker."""

    number: int  # the case's number in the sweep
    scene: Scene  # the case's scene
    group: str  # key of the index field that cases share
    # scenes of the group, one of which has the widest view; which one depends on the place of the flow's front
    widest: tuple[Scene, ...]


def make_cases(scenes: Sequence[Scene | None]) -> list[Case]:
    """Return the cases that have a scene, ordered by group."""
    groups: dict[str, list[int]] = {}
    for number, scene in enumerate(scenes):
        if scene is not None:
            groups.setdefault(_field_key(scene), []).append(number)
    cases = []
    for key, numbers in groups.items():
        members = [scene for number in numbers if (scene := scenes[number]) is not None]
        widest = _widest(members)
        cases += [Case(number, scene, key, widest) for number, scene in zip(numbers, members, strict=True)]
    return cases


def _widest(scenes: Sequence[Scene]) -> tuple[Scene, ...]:
    """Return the scenes whose view is not contained in another scene's view."""
    views = {view_extent(scene): scene for scene in scenes}
    ahead: list[tuple[float, float, float]] = []
    for view in sorted(views, key=lambda view: (-view[0], -view[1], view[2])):
        if not any(one[1] >= view[1] and one[2] <= view[2] for one in ahead):
            ahead.append(view)
    return tuple(views[view] for view in ahead)


def _key(*parts: Any) -> str:
    return json.dumps(parts, sort_keys=True)


def _field_key(scene: Scene) -> str:
    tables = scene.as_dict()
    view = [tables["pupil"], tables["receiver"]] if scene.has_own_pupil else scene.receiver.aperture_z
    return _key(tables["flow"], tables["grid"], view)


def _strehl_key(scene: Scene, group: str) -> str:
    tables = scene.as_dict()
    shape = [tables["receiver"][name] for name in ("diameter", "shape", "inner_diameter", "height")]
    return _key(group, shape, tables["pupil"], tables["strehl"], tables["trace"])


class Stages:
    """The stages that a worker process caches during its life.

    Attributes:
        counts: How often each stage was computed: "flow", "index", "strehl", "echo".
    """

    def __init__(self) -> None:
        """Start with an empty cache."""
        self.counts = dict.fromkeys(("flow", "index", "strehl", "echo"), 0)
        self._caches: dict[str, dict[str, Any]] = {}

    def _cached(self, kind: str, key: str, make: Callable[[], Any]) -> Any:
        cache = self._caches.setdefault(kind, {})
        if key in cache:
            cache[key] = cache.pop(key)  # keep the dict ordered by last use
            return cache[key]
        while len(cache) >= CACHED:
            del cache[next(iter(cache))]  # free memory before the next stage: fields can be large
        result = cache[key] = make()
        self.counts[kind] += 1
        return result

    def run(self, case: Case) -> RunResult:
        """Compute a case."""
        result = run_stages(case.scene, partial(self._prepared, case), partial(self._strehl, case), with_views=False)
        self.counts["echo"] += 1
        return result

    def _prepared(self, case: Case) -> Prepared:
        def make() -> Prepared:
            table, cached = case.scene.as_dict()["flow"], self._caches.get("flow", {})
            key = _key({name: value for name, value in table.items() if name not in _INDEX_KEYS})
            # Flows of one geometry share the mesh, with what is cached on it.
            density = self._cached(
                "flow", key, lambda: on_known_geometry(case.scene.density_field(), list(cached.values()))
            )
            front = float(density.box[1][-1])
            widest = max(case.widest, key=lambda scene: view_radius(scene, front))
            return prepare_field(widest, density)

        return self._cached("index", case.group, make)

    def _strehl(self, case: Case, field: IndexField) -> StrehlEstimate:
        return self._cached("strehl", _strehl_key(case.scene, case.group), lambda: scene_strehl(case.scene, field))


def compute(case: Case) -> dict[str, Any]:
    """Compute a case; return {"summary": ...}, or {"error": ...} if it cannot be computed, as plain JSON types."""
    begin = time.process_time()
    try:
        summary = dict(OPENED.once("stages of cases", Stages).run(case).summary)
        summary["processor_seconds"] = time.process_time() - begin
        return to_json({"summary": summary, "version": __version__})
    except Exception as fault:  # any error is recorded, so that the other cases go on
        text = " ".join(str(fault).split())
        kind = "" if isinstance(fault, ValueError) and text else f"{type(fault).__name__}: "
        return {"error": f"{kind}{text}", "version": __version__}
