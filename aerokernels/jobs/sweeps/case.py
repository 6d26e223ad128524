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
from typing import Any

from aerokernels import __version__
from aerokernels.echo.prediction import check_echo
from aerokernels.flow import DensityField
from aerokernels.flow.shared_geometry import on_known_geometry
from aerokernels.jobs.run import RunResult, echo_with_errors, scene_strehl
from aerokernels.jobs.store import to_json
from aerokernels.prepare import Prepared, prepare_field, view_extent, view_radius
from aerokernels.process.clock import clocked, processor_clocked
from aerokernels.process.opened import OPENED
from aerokernels.scene import Scene
from aerokernels.strehl import StrehlEstimate
from aerokernels.tracing.engines.choice import choose_backend

KEPT = 2  # number of latest flows, index fields and Strehl ratios that a process caches
_INDEX_KEYS = ("wavelength", "relation", "gladstone_dale")  # keys of [flow] that change the index but not the flow


@dataclass(frozen=True)
class Case:
    """A case as it is sent to a worker.

    Attributes:
        number: The case's number in the sweep.
        scene: The case's scene.
        group: Key of the index field that cases share.
        widest: Scenes of the group, one of which has the widest view; which one depends on the place of the flow's
            front.
    """

    number: int
    scene: Scene
    group: str
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
    view = [tables["pupil"], tables["receiver"]] if scene.looks_elsewhere else scene.receiver.aperture_z
    return _key(tables["flow"], tables["grid"], view)


def _flow_key(scene: Scene) -> str:
    return _key({name: value for name, value in scene.as_dict()["flow"].items() if name not in _INDEX_KEYS})


def _strehl_key(scene: Scene, group: str) -> str:
    tables = scene.as_dict()
    shape = [tables["receiver"][name] for name in ("diameter", "shape", "inner_diameter", "height")]
    return _key(group, shape, tables["pupil"], tables["strehl"], tables["trace"])


class Stages:
    """The stages that a worker process caches during its life.

    Attributes:
        made: How often each stage was computed: "flow", "index", "strehl", "echo".
    """

    def __init__(self) -> None:
        """Start with an empty cache."""
        self.made = dict.fromkeys(("flow", "index", "strehl", "echo"), 0)
        self._kept: dict[tuple[str, str], Any] = {}

    def _held(self, kind: str, key: str, make: Callable[[], Any]) -> Any:
        if (kind, key) in self._kept:
            self._kept[kind, key] = self._kept.pop((kind, key))  # keep the dict ordered by last use
            return self._kept[kind, key]
        alike = [name for name in self._kept if name[0] == kind]
        for name in alike[: max(0, len(alike) + 1 - KEPT)]:
            del self._kept[name]  # free memory before the next stage: fields can be large
        made = self._kept[kind, key] = make()
        self.made[kind] += 1
        return made

    def run(self, case: Case) -> RunResult:
        """Compute a case.

        Raises:
            ValueError: The scene cannot be computed.
        """
        scene = case.scene
        seconds: dict[str, float] = {}
        failed: dict[str, str] = {}

        def timed(name: str, work: Callable[[], Any]) -> Any:
            begin = time.perf_counter()
            try:
                return work()
            finally:
                seconds[name] = time.perf_counter() - begin

        with clocked() as stages:
            choose_backend(scene.trace.backend, scene.trace.device)
            prepared = timed("prepare", lambda: self._prepared(case))
            vacuum = check_echo(scene, prepared.field)
            strehl = timed("strehl", lambda: self._strehl(case, prepared))
            timed("error", lambda: strehl.quantities)
            try:
                found = timed("echo", lambda: echo_with_errors(vacuum, prepared.field, strehl))
            except ValueError as fault:
                found, failed["echo"] = None, str(fault)
            self.made["echo"] += 1
        seconds["total"] = stages["total"]
        return RunResult(scene, prepared, strehl, None, None, found, seconds, stages, failed)

    def _prepared(self, case: Case) -> Prepared:
        def make() -> Prepared:
            density = self._held("flow", _flow_key(case.scene), lambda: self._flow(case.scene))
            front = float(density.box[1][-1])
            widest = max(case.widest, key=lambda scene: view_radius(scene, front))
            return prepare_field(widest, density)

        return self._held("index", case.group, make)

    def _flow(self, scene: Scene) -> DensityField:
        """Return a scene's flow, sharing the mesh of a cached flow with the same geometry."""
        known = [made for (kind, _), made in self._kept.items() if kind == "flow"]
        return on_known_geometry(scene.density_field(), known)

    def _strehl(self, case: Case, prepared: Prepared) -> StrehlEstimate:
        key = _strehl_key(case.scene, case.group)
        return self._held("strehl", key, lambda: scene_strehl(prepared.field, case.scene))


def compute(case: Case) -> dict[str, Any]:
    """Compute a case; return {"summary": ...}, or {"error": ...} if it cannot be computed, as plain JSON types."""
    begin = time.process_time()
    try:
        with processor_clocked() as tracing:
            summary = dict(OPENED.once("stages of cases", Stages).run(case).summary)
        summary["tracing_processor_seconds"] = tracing[0]
        summary["processor_seconds"] = time.process_time() - begin
        return to_json({"summary": summary, "version": __version__})
    except Exception as fault:  # any error is recorded, so that the other cases go on
        text = " ".join(str(fault).split())
        kind = "" if isinstance(fault, ValueError) and text else f"{type(fault).__name__}: "
        return {"error": f"{kind}{text}", "version": __version__}
