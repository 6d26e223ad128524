"""The protocols that the recorder and the simulated board speak, and the oscilloscope dialects of one of them."""

PROTOCOLS = ("frames", "scpi")
DIALECT_NAMES = ("tektronix", "rigol")


def require_one_of(option: str, value: str, names: tuple[str, ...]) -> None:
    """Refuse a value that is none of `names`.

    Raises:
        ValueError: naming the ones there are.
    """
    if value not in names:
        raise ValueError(f"{option} {value!r}: give {', '.join(names[:-1])} or {names[-1]}")
