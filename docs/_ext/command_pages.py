"""The page of the command line, made from the commands themselves: usage, arguments, options with defaults, their help."""

import re
from typing import Any


def commands() -> dict[str, Any]:
    """Every command by name, in alphabetical order, as the parser knows it."""
    return dict(sorted(_leaves(_group()).items()))


def _group() -> Any:
    """The program, as the parser knows it."""
    import typer

    from aerokernels.cli import app

    return typer.main.get_command(app)


def _leaves(group: Any, before: str = "") -> dict[str, Any]:
    found = {}
    for name, command in group.commands.items():
        if getattr(command, "hidden", False):
            continue
        found[before + name] = command
        if hasattr(command, "commands"):
            found |= _leaves(command, f"{before}{name} ")
    return found


def options(command: Any) -> set[str]:
    """Every way to write an option of a command, those of every command among them."""
    params = [*command.params, *_group().params]
    return {text for param in params for text in (*param.opts, *param.secondary_opts)} | {"--help", "-h"}


def page() -> str:
    """The page."""
    parts = [
        "# Command line\n",
        "This page is made from the commands themselves: it says what `aerokernels COMMAND --help` says. A command reads a SCENE: a "
        "TOML file, or the name of a scene that ships. Quantities are written with their unit, in quotes.\n",
        "Exit status: 0 done; 1 failed; 2 bad input, with one line that names the file, the key and the remedy; 3 the answer is worth "
        "nothing, because its error is greater than the number; 130 interrupted (143 by SIGTERM, 129 by a terminal that closed).\n",
        "Options of every command:\n",
        _table(_rows(_group().params)),
    ]
    for name, command in commands().items():
        parts.append(f"## {name}\n")
        usage = " ".join(["aerokernels", name, "[OPTIONS]", *map(_usage, _arguments(command))])
        parts.append(f"```text\n{usage}\n```\n")
        parts.append(_prose(command.help or "") + "\n")
        if command.params:
            parts.append(_table(_rows(command.params)))
    return "\n".join(parts)


def _arguments(command: Any) -> list[Any]:
    return [param for param in command.params if param.param_type_name == "argument"]


def _rows(params: list[Any]) -> list[tuple[str, str, str]]:
    """What is written, its default and its meaning: arguments first."""
    rows = []
    for kind, written in (("argument", lambda param: f"`{_metavar(param)}`"), ("option", _written)):
        for param in params:
            if param.param_type_name == kind and not getattr(param, "hidden", False):
                meaning = _prose(getattr(param, "help", None) or "").replace("\n", " ")
                rows.append((written(param), _default(param), meaning))
    return rows


def _table(rows: list[tuple[str, str, str]]) -> str:
    lines = ["| argument or option | default | meaning |", "|---|---|---|"]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _usage(param: Any) -> str:
    name = _metavar(param)
    name = f"{name}..." if param.nargs == -1 else name
    return name if param.required else f"[{name}]"


def _metavar(param: Any) -> str:
    return re.sub(r"[\[\].]", "", param.metavar or param.name.upper())


def _written(param: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*param.opts, *param.secondary_opts))
    return names if getattr(param, "is_flag", False) else f"{names} {param.metavar or param.name.upper()}"


def _default(param: Any) -> str:
    if param.required:
        return "required"
    value = param.default
    if value is None or callable(value) or value is False or value == () or "Sentinel" in type(value).__name__:
        return ""
    return "on" if value is True else f"`{value}`"


def _prose(text: str) -> str:
    """Help text as Markdown: underscores and brackets stay what they are."""
    text = re.sub(r"\[/?(?:bold|dim|italic)\]", "", text.replace("\b", "")).strip()
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if number % 2 else re.sub(r"([*_\[\]<>])", r"\\\1", part) for number, part in enumerate(parts))
