"""The command `sgslam` with its sub-commands: `sgslam run ...` is `python -m sgslam.run ...`.

It imports only the module of the sub-command that is called.
"""

import difflib
import importlib
import sys
from dataclasses import dataclass

from data.common.cli import called_as, run_command
from data.common.errors import UserError
from sgslam.own_packages import foreign_package


@dataclass(frozen=True)
class Command:
    """A sub-command: the module whose `main` it calls, and a one-line description."""

    module: str
    about: str


COMMANDS = {
    "run": Command("sgslam.run", "estimate a trajectory in building coordinates from scans and a plan"),
    "batch": Command("sgslam.cli.batch", "run many jobs, here or on a cluster, and summarise them on one page"),
    "live": Command("sgslam.live.__main__", "track scans as they arrive, and print pose and health of each"),
    "anchor": Command("sgslam.other_slam.anchor", "anchor another SLAM system's finished output to a plan"),
    "view": Command("sgslam.cli.view", "show finished runs in the browser"),
    "show": Command("sgslam.cli.show", "show a finished run in Open3D's viewer"),
    "match": Command("matching.match", "find where a map (S-graph) is in a plan (A-graph)"),
    "inspect-bim": Command("sgslam.cli.inspect_bim", "check a plan: gaps, symmetries, rooms needed to localise"),
    "export": Command("sgslam.cli.export", "export a finished run to the formats of other programs"),
    "compare": Command("sgslam.as_built.compare", "list what was built, removed or moved between two runs"),
    "simulate": Command("data.simulate", "simulate a LiDAR that a robot or a person carries through a building"),
    "train": Command("matching.train", "train the matcher's network"),
    "evaluate": Command("evaluation.__main__", "run studies; 'sgslam evaluate list' lists them"),
    "doctor": Command("sgslam.cli.doctor", "check the installation"),
    "dump-config": Command("sgslam.cli.dump_config", "print all settings with descriptions, as YAML for --config"),
}


def main() -> None:
    """The entry point of the command `sgslam`; ends the process."""
    run_command(lambda: call(sys.argv[1:]))


def call(arguments: list[str]) -> int | None:
    """Calls the sub-command named by the first argument with the others. Raises UserError for an unknown name."""
    name, *rest = arguments or ["--help"]
    if name in ("--help", "-h"):
        return _print_help()
    if name == "--version":
        from importlib.metadata import version  # slow to import

        print(f"sgslam {version('sgslam')}")
        return 0
    command = _find(name)
    if message := foreign_package(command.module.partition(".")[0]):
        raise UserError(message)
    return _run(command, f"sgslam {name}", rest)


def _find(name: str) -> Command:
    if name in COMMANDS:
        return COMMANDS[name]
    near = difflib.get_close_matches(name, COMMANDS, 1, 0.0)[0]
    raise UserError(f"no command '{name}'; did you mean '{near}'? 'sgslam --help' lists all commands")


def _run(command: Command, name: str, arguments: list[str]) -> int | None:
    """Runs the command's `main`, which reads `sys.argv`."""
    sys.argv = [name, *arguments]
    with called_as(name):
        code: int | None = importlib.import_module(command.module).main()
    return code


def _print_help() -> int:
    width = max(map(len, COMMANDS)) + 2
    lines = [f"  {name:<{width}}{command.about}" for name, command in COMMANDS.items()]
    about = "Indoor LiDAR SLAM that knows the building's plans."
    last = "'sgslam COMMAND --help' shows the options of a command."
    print("\n".join(["usage: sgslam COMMAND ...", "", about, "", *lines, "", last]))
    return 0
