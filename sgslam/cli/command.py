"""The command `sgslam` with its sub-commands: `sgslam run ...` is `python -m sgslam.run ...`.

It imports only the module of the sub-command that is called.
"""

import difflib
import importlib
import sys

from data.common.cli import called_as, run_command
from data.common.errors import UserError
from sgslam.own_packages import foreign_package

COMMANDS = {  # the module whose `main` is called, and a line for the help
    "run": ("sgslam.run", "estimate a trajectory in building coordinates from scans and a plan"),
    "batch": ("sgslam.cli.batch", "run many jobs, here or on a cluster, and summarise them on one page"),
    "live": ("sgslam.live.__main__", "track scans as they arrive, and print pose and health of each"),
    "anchor": ("sgslam.other_slam.anchor", "anchor another SLAM system's finished output to a plan"),
    "view": ("sgslam.cli.view", "show finished runs in the browser"),
    "match": ("matching.match", "find where a map (S-graph) is in a plan (A-graph)"),
    "inspect-bim": ("sgslam.cli.inspect_bim", "check a plan: gaps, symmetries, rooms needed to localise"),
    "export": ("sgslam.cli.export", "export a finished run to the formats of other programs"),
    "compare": ("sgslam.as_built.compare", "list what was built, removed or moved between two runs"),
    "simulate": ("data.simulate", "simulate a LiDAR that a robot or a person carries through a building"),
    "train": ("matching.train", "train the network that judges places"),
    "evaluate": ("evaluation.__main__", "run studies; 'sgslam evaluate list' lists them"),
    "doctor": ("sgslam.cli.doctor", "check the installation"),
    "dump-config": ("sgslam.cli.dump_config", "print all settings with descriptions, as YAML for --config"),
}


def main() -> None:
    """The entry point of the command `sgslam`; ends the process."""
    run_command(lambda: call(sys.argv[1:]))


def call(arguments: list[str]) -> int | None:
    """Calls the sub-command named by the first argument with the others. Raises UserError for an unknown name."""
    name, *rest = arguments or ["--help"]
    if name in ("--help", "-h"):
        lines = [f"  {command:<{max(map(len, COMMANDS)) + 2}}{about}" for command, (_, about) in COMMANDS.items()]
        print("usage: sgslam COMMAND ...\n\nIndoor LiDAR SLAM that knows the building's plans.\n", *lines, sep="\n")
        print("\n'sgslam COMMAND --help' shows the options of a command.")
        return 0
    if name == "--version":
        from importlib.metadata import version  # slow to import

        print(f"sgslam {version('sgslam')}")
        return 0
    if name not in COMMANDS:
        close = ["view"] if name == "show" else difflib.get_close_matches(name, COMMANDS, 1)
        near = "".join(f"; did you mean '{own}'?" for own in close)
        raise UserError(f"no command '{name}'{near or ';'} 'sgslam --help' lists all commands")
    module = COMMANDS[name][0]
    if message := foreign_package(module.partition(".")[0]):
        raise UserError(message)
    sys.argv = [f"sgslam {name}", *rest]
    with called_as(sys.argv[0]):
        code: int | None = importlib.import_module(module).main()
    return code
