"""Memory on a device for the values of one field at a time, and what is launched for each: tables, pilot and pupil.

It is prepared once for the nodes of a grid. For the values of another field the same launches are started again, on a
GPU as one graph or without setting an argument, which takes far less time than to prepare them.
"""

import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...medium import IndexField
from ...medium.grid import FETCH, UniformGrid
from ...rays import RayBundle
from ..engines import engine_of
from ..error_limit import peaks_along_axes, potential_peaks
from ..grid_tables import GridTables, keep_tables
from ..launch import RepeatedTrials, Trials
from ..leapfrog.pilot import pair_numbers
from ..leapfrog.sample_count import PILOT_OUTPUTS
from .run import PupilRun
from .sums import PupilSums, PupilTask

# Fields that may be in memory at a time, each used by one thread of a CPU.
MOST = 2  # speed only


class ValuesInTurn:
    """The memory, which one thread uses at a time.

    Attributes:
        lock: Held by the thread that uses it.
        run: The pupil's rays.
    """

    run: PupilRun

    def __init__(self, task: PupilTask, pilot: RayBundle):
        """Prepare the pilot of a task whose field nothing else uses: only those of others are loaded."""
        field, plan = task.field, task.plan
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        self.lock = threading.Lock()
        self.field, self.precision = field, plan.precision
        self.engine = engine = engine_of(plan.backend, plan.device)
        self.tables = tables = GridTables(engine, grid)
        grid.derive(engine.grid_key, lambda: tables.coefficients)
        if tables.on_host is not None:
            on_host = tables.on_host.reshape(grid.coefficient_shape)
            grid.derive(FETCH, lambda: lambda: on_host)
        self.samples: Any = None  # on a CPU kernels read those of the fields themselves
        if engine.is_gpu:
            self.samples = engine.sent(engine.room((grid.samples.size,), np.float64))
        trials = Trials(field, pilot, plan, task.until, task.wavelength, PILOT_OUTPUTS)
        self.trials = RepeatedTrials(trials, pair_numbers(plan.sample_count))
        self.reading = engine.fetched(self.trials.arrays)  # in one copy
        self.trials.into(self.reading.buffers)
        self.repeat = engine.recorded()
        self._holds: Any = None  # refers weakly to the samples whose values are in memory

    def prepare(self, task: PupilTask) -> "ValuesInTurn":
        """Prepare the pupil's rays too, by a plan whose scales of a ray's error are known."""
        self.run = PupilRun(task)
        return self

    def holds(self, field: IndexField) -> bool:
        """Whether the values in memory are those of a field."""
        return self._holds is not None and self._holds() is field.samples

    def load(self, field: IndexField) -> None:
        """Start the launches for the values of a field; `read` must be called before anything else."""
        samples = field.samples
        assert isinstance(samples, UniformGrid)
        self._holds = None
        if self.samples is None:
            self._start(self.engine.share(samples.doubles))
        else:
            self.samples.send(samples.doubles)  # not with the launches, which may be replayed as one graph
            self.repeat(self._start_from_buffer)
        self._holds = weakref.ref(samples)

    def read(self, field: IndexField) -> list[dict[str, np.ndarray]]:
        """Wait for the launches, cache the tables on the loaded field, and return the pilot's rays (see pair_numbers).

        The rays are valid until the next load.
        """
        arrays = self.reading.wait()
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        keep_tables(grid, self.tables.read())
        if self.tables.on_host is not None:
            potential_peaks.keep(peaks_along_axes(self.tables.on_host.reshape(grid.coefficient_shape)), grid)
        return self.trials.outputs(arrays)

    def leave(self, field: IndexField) -> None:
        """Leave a copy of the coefficients with the loaded field, which needs them again, on a CPU."""
        if self.tables.on_host is not None:
            coefficients = self.tables.on_host.reshape(field.samples.coefficient_shape).copy()
            coefficients.setflags(write=False)
            field.samples.derive(FETCH, lambda: lambda: coefficients)

    def _start_from_buffer(self) -> None:
        self._start(self.samples.buffer)

    def _start(self, samples: Any) -> None:
        """Start the launches for the samples in a buffer."""
        self.tables.start(samples)
        self.engine.renew(self.field, self.precision, self.tables.on_host)
        self.trials.launch()
        self.reading.start()


class MemoryInTurn:
    """Memory for as many fields at a time as threads use it."""

    def __init__(self, first: ValuesInTurn, another: Callable[[], ValuesInTurn]):
        """Take the first memory, and a function that prepares more of it."""
        self._another, self._places, self._lock = another, [first], threading.Lock()
        self._most = 1 if first.engine.is_gpu else MOST  # threads share the stream of a GPU

    @contextmanager
    def taken(self) -> Iterator[ValuesInTurn]:
        """Memory that no other thread uses meanwhile."""
        place = self._take()
        try:
            yield place
        finally:
            place.lock.release()

    def _take(self) -> ValuesInTurn:
        with self._lock:
            for place in self._places:
                if place.lock.acquire(blocking=False):
                    return place
            if len(self._places) < self._most:
                self._places.append(self._another())
            place = self._places[-1]
        place.lock.acquire()
        return place

    def sums(self, seed: int | None, field: IndexField) -> PupilSums | None:
        """Trace and sum the rays of a seed, if the field's values are still in memory."""
        for place in self._places:
            with place.lock:
                if place.holds(field):
                    return place.run(seed, field)
        return None
