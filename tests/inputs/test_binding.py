"""Arguments bound to parameters: as `inspect.Signature.bind` binds them, or its TypeError."""

import inspect

import pytest

from aerokernels.inputs.arguments import Binding


def plain(first, second=2, *, third, fourth=4):
    """Only parameters with names."""


def by_position(first, second=2, *, third=3):
    """None of the needed ones is by name only."""


def open_ended(first, /, *rest, named=1, **others):
    """All other kinds."""


@pytest.mark.parametrize("function", [plain, by_position, open_ended])
@pytest.mark.parametrize("given", [(), (1,), (1, 2), (1, 2, 3), (1, 2, 3, 4, 5)])
@pytest.mark.parametrize(
    "named",
    [{}, {"third": 3}, {"fourth": 5, "third": 3, "second": 1}, {"first": 0}, {"third": 3, "unknown": 1}, {"named": 2}],
)
def test_arguments_are_bound_as_python_binds_them(function, given, named):
    signature = inspect.signature(function)
    try:
        expected = dict(signature.bind(*given, **named).arguments)
    except TypeError as error:
        with pytest.raises(TypeError, match=str(error)):
            Binding(signature).bind(given, named)
    else:
        found = Binding(signature).bind(given, named)
        assert list(found.items()) == list(expected.items())
