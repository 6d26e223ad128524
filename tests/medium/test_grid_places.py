"""Grids on the same nodes share what depends on the nodes alone, for as long as one of them exists."""

import copy
import gc
import pickle
import weakref

import numpy as np
import pytest

from aerokernels import IndexField
from aerokernels.derived import cached_on
from aerokernels.medium.grid import UniformGrid


def grid(value: float = 0.0, **other) -> UniformGrid:
    """Four by five nodes, all of one contrast."""
    given = {
        "samples": np.full((4, 5), value),
        "origin": np.array([0.0, 1.0]),
        "spacing": np.array([0.1, 0.2]),
        "interpolation": "cubic",
        "even_first_axis": True,
        "ambient_index": 1.0,
    }
    return UniformGrid(**{**given, **other})


def test_other_values_on_the_same_nodes_share_positions():
    """Contrast, interpolant and ambient index do not matter; neither do copies and pickles."""
    one = grid()
    for other in (
        grid(1e-4),
        grid(interpolation="linear"),
        grid(ambient_index=1.3),
        copy.deepcopy(one),
        pickle.loads(pickle.dumps(one)),
    ):
        assert other.places is one.places


@pytest.mark.parametrize(
    "other",
    [
        {"samples": np.zeros((5, 4))},
        {"origin": np.array([0.0, np.nextafter(1.0, 2.0)])},
        {"spacing": np.array([0.1, 0.2 + 1e-16])},
        {"even_first_axis": False},
    ],
    ids=["shape", "origin", "spacing", "mirror"],
)
def test_other_nodes_do_not(other):
    """One unit in the last place makes other nodes."""
    one = grid()
    assert grid(**other).places is not one.places


def test_a_loop_over_fields_keeps_what_it_found_and_the_last_field_frees_it():
    """A name that gets the next field holds the last one until then."""
    made: list[weakref.ref] = []

    class Result:
        def __init__(self):
            made.append(weakref.ref(self))

    @cached_on("places")
    def found(places) -> Result:
        return Result()

    samples = np.full((6, 7), 1e-4)
    field = None
    for _ in range(3):
        field = IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry="planar")
        found(field.samples.places)
    assert len(made) == 1 and made[0]() is not None
    del field
    gc.collect()
    assert made[0]() is None
