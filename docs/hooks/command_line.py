"""The reference of the command line, from the commands themselves."""

import inspect
from typing import Any

import typer
from table_rows import table

from inertiax.cli.app import app


def page() -> str:
    """A section for each command: what it does, how it is called, its arguments and options."""
    commands = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
    return "\n\n".join(_section(name, command) for name, command in commands.items())


def _section(name: str, command: Any) -> str:
    shown = [p for p in command.params if not getattr(p, "hidden", False)]
    arguments = [p for p in shown if p.param_type_name == "argument"]
    options = [p for p in shown if p.param_type_name == "option"]
    usage = " ".join(
        [
            "inertiax",
            name,
            *(_usage(p) for p in arguments),
            *(_usage(p) for p in options if p.required),
        ]
    )
    parts = [
        f"## inertiax {name}",
        inspect.cleandoc(command.help or ""),
        f"```text\n{usage} [OPTIONS]\n```",
    ]
    if arguments:
        rows = [(f"`{_metavar(p)}`", _meaning(p)) for p in arguments]
        parts.append(table(("argument", "meaning"), rows))
    for panel, members in _panels(options).items():
        title = "option" if panel is None else panel
        parts.append(table((title, "meaning"), [(_spelling(p), _meaning(p)) for p in members]))
    return "\n\n".join(parts)


def _panels(options: list[Any]) -> dict[str | None, list[Any]]:
    panels: dict[str | None, list[Any]] = {}
    for option in options:
        panels.setdefault(getattr(option, "rich_help_panel", None), []).append(option)
    return panels


def _usage(parameter: Any) -> str:
    if parameter.param_type_name == "option":
        return f"{max(parameter.opts, key=len)} {_metavar(parameter)}"
    name = _metavar(parameter) + ("..." if parameter.nargs == -1 else "")
    return name if parameter.required else f"[{name}]"


def _metavar(parameter: Any) -> str:
    """`DIR` of `--output DIR`; nothing for a switch."""
    if getattr(parameter, "is_flag", False):
        return ""
    return (parameter.metavar or _kind(parameter)).strip("{}[]")


def _kind(parameter: Any) -> str:
    """`FLOAT`, by whichever of its two ways the installed typer says a parameter's type."""
    if hasattr(parameter, "type"):
        return str(parameter.type.name).upper()
    return parameter.type_descriptor.annotation.__name__.upper()


def _spelling(option: Any) -> str:
    names = sorted([*option.opts, *option.secondary_opts], key=len, reverse=True)
    spelt = f"{', '.join(names)} {_metavar(option)}".strip()
    return f"`{spelt}`"


def _meaning(parameter: Any) -> str:
    said = " ".join((parameter.help or "").split())
    default = (
        parameter.show_default if isinstance(parameter.show_default, str) else parameter.default
    )
    if parameter.param_type_name == "option" and default not in (None, False, "", (), []):
        value = " ".join(map(str, default)) if isinstance(default, tuple) else default
        said += f" Default: `{value}`."
    return said.replace("<", "&lt;").replace("[", "\\[").strip()
