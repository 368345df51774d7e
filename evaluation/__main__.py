"""The measurements.

    python -m evaluation list | run NAME ... [--quick] | render

`run` computes the rows of studies, `render` writes all pages from the rows. `run` exits with 1 if a case failed; all
rows are kept.
"""

import argparse
import shlex
from importlib.util import find_spec
from pathlib import Path

from data.common.build import content_hash
from data.common.cli import Parser, add_workers, run_command
from data.common.errors import UserError
from data.common.processes import cores
from evaluation.study import STUDIES, Options, Study, load_study

WORK = Path("out/evaluation")


def main(arguments: list[str] | None = None) -> int:
    """The command line. Raises UserError."""
    options = _parser().parse_args(arguments)
    if find_spec("pandas") is None:
        raise UserError("measurements need pandas; pip install 'sgslam[evaluation]'")
    if options.command == "list":
        return _list()
    if options.command == "render":
        from evaluation.render import render, render_folder

        changed = render() if options.rows is None else render_folder(options.rows)
        print("\n".join(f"{path}: written" for path in changed) or "all pages are up to date")
        return 0
    return _run(options)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m evaluation", description="Run studies of accuracy, matching and time.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="list | run | render")
    commands.add_parser("list", help="list the studies", description="List the studies and their options.")
    about = "Run studies and store their results as rows; rows of this build are not computed again."
    run = commands.add_parser("run", help="run studies and store their results as rows", description=about)
    run.add_argument("studies", nargs="+", metavar="NAME", help="studies, or 'all' that need no data of yours")
    run.add_argument("--quick", action="store_true", help="run the short version")
    run.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE", help="options of the study; see 'list'")
    about = "folder of a data set for the study 'real', short for --set dataset=DIR"
    run.add_argument("--dataset", metavar="DIR", help=about)
    run.add_argument("--rows", type=Path, metavar="DIR", help="folder of the rows (default: the project's own)")
    run.add_argument("--work", type=Path, default=WORK, metavar="DIR", help="folder for drives (default: %(default)s)")
    add_workers(run, "--jobs", "number of processes (default: one per core)")
    run.set_defaults(jobs=cores())
    about = "Write all pages of results from the rows."
    render = commands.add_parser("render", help="write all pages of results from the rows", description=about)
    about = "write tables of the rows in this folder into it, as Markdown and LaTeX, instead of the project's pages"
    render.add_argument("--rows", type=Path, metavar="DIR", help=about)
    return parser


def _list() -> int:
    for name in STUDIES:
        study = load_study(name)
        print(f"{name}: {study.asks}")
        for option, field in study.options.model_fields.items():
            quick = getattr(study.quick, option)
            short = "" if quick == field.default else f", --quick: {quick}"
            print(f"    {option} = {field.default}{short}")
    return 0


def _run(options: argparse.Namespace) -> int:
    from evaluation.render import QUICK, ROWS
    from evaluation.running import Place, run_study

    if options.jobs < 1:
        raise UserError(f"--jobs {options.jobs}: must be at least 1")
    if options.dataset is not None:
        options.set = [f"dataset={options.dataset}", *options.set]
    studies = _studies(options.studies)
    chosen = [_options(study, options.quick, options.set) for study in studies]
    folder = options.rows or ROWS
    work = options.work / content_hash(("data",))  # drives of another simulator are not used
    place = Place(folder / QUICK if options.quick else folder, work, options.jobs, options.scheduler)
    failed = []
    for study, own in zip(studies, chosen, strict=True):
        rows = run_study(study, own, place, _command(study.name, options), whole=not options.set)
        failed += [f"{study.name}: failed: {row.key}: {row.record['reason']}" for row in rows if row.failed]
    print("\n".join(failed))
    return 1 if failed else 0


def _studies(names: list[str]) -> list[Study]:
    """The studies of these names; `all` is every one that needs no data of the user's."""
    if names == ["all"]:
        return [study for study in map(load_study, STUDIES) if not study.brought]
    return [load_study(name) for name in names]


def _command(study: str, options: argparse.Namespace) -> str:
    """The command for one study's rows, without what they do not depend on."""
    words = ["python", "-m", "evaluation", "run", study, *(["--quick"] if options.quick else [])]
    return shlex.join([*words, *(["--set", *options.set] if options.set else [])])


def _options(study: Study, quick: bool, changes: list[str]) -> Options:
    """The options of a run. Raises UserError for unknown names and invalid values."""
    import yaml
    from pydantic import ValidationError

    values = (study.quick if quick else study.options()).model_dump()
    for change in changes:
        name, _, text = change.partition("=")
        if name not in values:
            raise UserError(f"--set {change}: {study.name} has no option '{name}'; it has {', '.join(values)}")
        values[name] = yaml.safe_load(text)
    try:
        return study.options.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        raise UserError(f"--set {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


if __name__ == "__main__":
    run_command(main)
