"""`python -m sgslam.cli.dump_config`: every setting with what it means, as YAML that `--config` reads back."""

from pathlib import Path

from data.common.cli import Parser, run_command


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError for settings that are wrong."""
    parser = Parser(prog="python -m sgslam.cli.dump_config", description="Every setting with what it means, as YAML.")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings as YAML, in place of the defaults")
    parser.add_argument("--set", action="append", default=[], metavar="A.B=C", help="one setting; may be given again")
    parser.add_argument("--markdown", action="store_true", help="as a page of tables instead")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where it is written (default: standard output)")
    options = parser.parse_args(arguments)
    from data.common.files import write_atomically
    from sgslam.config.dump import explained
    from sgslam.config.loading import load_config

    config = load_config(options.config, options.set)
    if options.markdown:
        from sgslam.config.reference import parameters_page

        text = parameters_page(config)
    else:
        text = explained(config)
    if options.out is None:
        print(text, end="")
    else:
        write_atomically(options.out, text)
    return 0


if __name__ == "__main__":
    run_command(main)
