"""The command `sgslam`: one name for every command of ours. `sgslam run ...` is `python -m sgslam.run ...`.

It knows the commands by their names and one line each, and loads nothing else but the one that is called.
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
    """The module whose `main` it calls, and what it is for."""

    module: str
    about: str


COMMANDS = {
    "run": Command("sgslam.run", "scans and a building's plan in, a trajectory in building coordinates out"),
    "view": Command("sgslam.cli.view", "finished runs as a page in the browser"),
    "match": Command("matching.match", "finds where a map's scene graph lies in a plan's"),
    "inspect-bim": Command("sgslam.cli.inspect_bim", "what a plan lacks, where it is its own twin, rooms to see"),
    "export": Command("sgslam.cli.export", "a finished run in the forms that other programs read"),
    "simulate": Command("data.simulate", "drives a simulated robot through a building"),
    "train": Command("matching.train", "trains the matcher's network anew"),
    "evaluate": Command("", "measurements; 'sgslam evaluate' lists them"),
    "doctor": Command("sgslam.cli.doctor", "whether what is installed works here"),
    "dump-config": Command("sgslam.cli.dump_config", "every setting with what it means, as YAML for --config"),
}


def measurements() -> dict[str, Command]:
    """The commands of `evaluation`, each with what the first line of its module says.

    Raises UserError where Python finds another package of that name.
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
    """What `sgslam` is installed as; ends the process."""
    run_command(lambda: call(sys.argv[1:]))


def call(arguments: list[str]) -> int | None:
    """Calls the command that is named first with what follows. Raises UserError where there is none of that name."""
    name, *rest = arguments or ["--help"]
    if name in ("--help", "-h"):
        return _tell("sgslam COMMAND ...", "Indoor LiDAR SLAM that knows the building's plans.", COMMANDS)
    if name == "--version":
        from importlib.metadata import version  # slow to load, for one line

        print(f"sgslam {version('sgslam')}")
        return 0
    if name == "evaluate":
        name, *rest = rest or ["--help"]
        if name in ("--help", "-h"):
            return _tell("sgslam evaluate NAME ...", "Measurements; each tells its options by --help.", measurements())
        return _called(
            _known(name.replace("-", "_"), measurements(), "sgslam evaluate"), f"sgslam evaluate {name}", rest
        )
    return _called(_known(name, COMMANDS, "sgslam"), f"sgslam {name}", rest)


def _known(name: str, commands: dict[str, Command], of: str) -> Command:
    if name in commands:
        return commands[name]
    near = difflib.get_close_matches(name, commands, 1, 0.0)[0]
    raise UserError(f"{of}: no command '{name}'; the nearest is '{near}', '{of} --help' lists all")


def _called(command: Command, name: str, arguments: list[str]) -> int | None:
    """The commands read `sys.argv`, some of them to write down how they were called."""
    sys.argv = [name, *arguments]
    with called_as(name):
        code: int | None = importlib.import_module(command.module).main()
    return code


def _tell(usage: str, about: str, commands: dict[str, Command]) -> int:
    width = max(map(len, commands)) + 2
    lines = [f"  {name:<{width}}{command.about}" for name, command in commands.items()]
    last = f"'{usage.removesuffix(' ...')} --help' tells the options of each."
    print("\n".join([f"usage: {usage}", "", about, "", *lines, "", last]))
    return 0
