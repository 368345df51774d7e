"""The command `sgslam` with its sub-commands: `sgslam run ...` is `python -m sgslam.run ...`.

It imports only the module of the sub-command that is called.
"""

import difflib
import importlib
import sys
from dataclasses import dataclass

from data.common.cli import called_as, run_command
from data.common.errors import UserError
from sgslam.own_packages import ROOT, foreign_package


@dataclass(frozen=True)
class Command:
    """A sub-command: the module whose `main` it calls, and a one-line description."""

    module: str
    about: str


COMMANDS = {
    "run": Command("sgslam.run", "estimate a trajectory in building coordinates from scans and a plan"),
    "view": Command("sgslam.cli.view", "show finished runs in the browser"),
    "match": Command("matching.match", "match an S-graph with a plan's A-graph"),
    "inspect-bim": Command("sgslam.cli.inspect_bim", "check a plan: gaps, symmetries, rooms needed to localise"),
    "export": Command("sgslam.cli.export", "export a finished run to the formats of other programs"),
    "simulate": Command("data.simulate", "simulate a robot with a LiDAR driving through a building"),
    "train": Command("matching.train", "train the matcher's network"),
    "evaluate": Command("", "measurements; 'sgslam evaluate' lists them"),
    "doctor": Command("sgslam.cli.doctor", "check the installation"),
    "dump-config": Command("sgslam.cli.dump_config", "print all settings with descriptions, as YAML for --config"),
}


def measurements() -> dict[str, Command]:
    """The commands of `evaluation` by name, each described by the first line of its module.

    Raises UserError if Python finds another package of that name.
    """
    if message := foreign_package("evaluation"):
        raise UserError(message)
    found = {}
    for path in sorted((folder := ROOT / "evaluation").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "run_command(main)" in text:
            name = ".".join(path.relative_to(folder).with_suffix("").parts)
            first = text.removeprefix('"""').partition("\n")[0].strip('"')
            found[name] = Command(f"evaluation.{name}", (first.partition("`: ")[2] or first).rstrip("."))
    return found


def main() -> None:
    """The entry point of the command `sgslam`; ends the process."""
    run_command(lambda: call(sys.argv[1:]))


def call(arguments: list[str]) -> int | None:
    """Calls the sub-command named by the first argument with the others. Raises UserError for an unknown name."""
    name, *rest = arguments or ["--help"]
    if name in ("--help", "-h"):
        return _print_help("sgslam COMMAND ...", "Indoor LiDAR SLAM that knows the building's plans.", COMMANDS)
    if name == "--version":
        from importlib.metadata import version  # slow to import

        print(f"sgslam {version('sgslam')}")
        return 0
    if name == "evaluate":
        name, *rest = rest or ["--help"]
        if name in ("--help", "-h"):
            return _print_help("sgslam evaluate NAME ...", "Measurements of accuracy and time.", measurements())
        command = _find(name.replace("-", "_"), measurements(), "sgslam evaluate")
        return _run(command, f"sgslam evaluate {name}", rest)
    return _run(_find(name, COMMANDS, "sgslam"), f"sgslam {name}", rest)


def _find(name: str, commands: dict[str, Command], of: str) -> Command:
    if name in commands:
        return commands[name]
    near = difflib.get_close_matches(name, commands, 1, 0.0)[0]
    raise UserError(f"{of}: no command '{name}'; did you mean '{near}'? '{of} --help' lists all commands")


def _run(command: Command, name: str, arguments: list[str]) -> int | None:
    """Runs the command's `main`, which reads `sys.argv`."""
    sys.argv = [name, *arguments]
    with called_as(name):
        code: int | None = importlib.import_module(command.module).main()
    return code


def _print_help(usage: str, about: str, commands: dict[str, Command]) -> int:
    width = max(map(len, commands)) + 2
    lines = [f"  {name:<{width}}{command.about}" for name, command in commands.items()]
    last = f"'{usage.removesuffix(' ...')} --help' shows the options of each."
    print("\n".join([f"usage: {usage}", "", about, "", *lines, "", last]))
    return 0
