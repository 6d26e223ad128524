"""`aerokernels backends`: list this machine's backends and devices."""


def backends() -> None:
    """List this machine's backends and devices.

    Also show active work-arounds, and what `auto` chooses and why.
    """
    from dataclasses import asdict

    from aerokernels.commands._output import note, output, say
    from aerokernels.commands._table import print_table
    from aerokernels.display.plain_text import plain
    from aerokernels.tracing import available_backends
    from aerokernels.tracing.engines.choice import choose_backend

    found = available_backends()
    backend, device, reason = choose_backend("auto", None)
    print_table(
        "Backends and devices",
        ("backend", "device", "version", "float64", "memory", "what it is"),
        [
            (
                info.backend,
                info.device,
                info.version,
                "-" if info.device == "-" else "yes" if info.float64 else "no",
                f"{info.memory / 2**30:.1f} GiB" if info.memory else "-",
                info.description if info.available else f"absent: {info.reason}",
            )
            for info in found
        ],
        {
            "backends": [asdict(info) for info in found],
            "auto": {"backend": backend, "device": device, "reason": reason},
        },
    )
    for info in found:
        if info.workaround:
            (note if output.as_json else say)(f"work-around on {info.device}: {info.workaround}")
    reason = reason.removeprefix(f"backend {backend} on {device}: ")
    if not output.as_json:
        say(plain(f"auto chooses {backend} on {device}: {reason}"))
