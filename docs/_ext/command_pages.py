"""The page of the command line, made from the commands themselves: usage, arguments, options with defaults, their help."""

import re
from typing import Any


def commands() -> dict[str, Any]:
    """Every command by name, in alphabetical order, as the parser knows it."""
    import typer

    from aerokernels.cli import app

    group: Any = typer.main.get_command(app)
    return dict(sorted(_leaves(group).items()))


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
    """Every way to write an option of a command, --help among them."""
    return {text for param in command.params for text in (*param.opts, *param.secondary_opts)} | {"--help", "-h"}


def page() -> str:
    """The page."""
    parts = [
        "# Command line\n",
        "This page is made from the commands themselves: it says what `aerokernels COMMAND --help` says. A command reads a SCENE: a "
        "TOML file, or the name of a scene that ships. Quantities are written with their unit, in quotes.\n",
        "Exit status: 0 done; 1 failed; 2 bad input, with one line that names the file, the key and the remedy; 3 the answer is worth "
        "nothing, because its error is greater than the number; 130 interrupted. `--debug`, anywhere on the line, shows where a "
        "command failed.\n",
    ]
    for name, command in commands().items():
        parts.append(f"## {name}\n")
        arguments = [param for param in command.params if param.param_type_name == "argument"]
        usage = " ".join(["aerokernels", name, "[OPTIONS]", *map(_usage, arguments)])
        parts.append(f"```text\n{usage}\n```\n")
        parts.append(_prose(command.help or "") + "\n")
        rows = [
            (f"`{_metavar(param)}`", _default(param), _prose(getattr(param, "help", None) or "").replace("\n", " "))
            for param in arguments
        ]
        rows += [
            (_written(param), _default(param), _prose(param.help or "").replace("\n", " "))
            for param in command.params
            if param.param_type_name == "option" and not param.hidden
        ]
        if rows:
            lines = ["| argument or option | default | meaning |", "|---|---|---|"]
            lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
            parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


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
