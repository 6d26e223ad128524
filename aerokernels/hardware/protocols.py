"""The protocols that the recorder and the simulated board speak."""

AVAILABLE_PROTOCOLS = ("frames",)


def require_protocol(protocol: str) -> None:
    """Refuse a protocol that is not available.

    Raises:
        ValueError: naming the ones that are.
    """
    if protocol not in AVAILABLE_PROTOCOLS:
        raise ValueError(
            f"protocol {protocol!r} is not available in this version: use --protocol {' or '.join(AVAILABLE_PROTOCOLS)}"
        )
