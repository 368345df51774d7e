"""`python -m sgslam.cli.dump_config`: prints all settings with their descriptions, as YAML for `--config`."""

from pathlib import Path

from data.common.cli import Parser, run_command
from sgslam.cli.options import add_options


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError for invalid settings."""
    about = "Print all settings with their descriptions, as YAML for --config."
    parser = Parser(prog="python -m sgslam.cli.dump_config", description=about)
    add_options(parser, "set", config={"help": "settings as YAML that replace the defaults"})
    parser.add_argument("--markdown", action="store_true", help="print Markdown tables instead of YAML")
    parser.add_argument("--out", type=Path, metavar="FILE", help="output file (default: standard output)")
    options = parser.parse_args(arguments)
    from data.common.files import write_atomically
    from sgslam.config.documented import documented_yaml, parameters_page
    from sgslam.config.loading import load_config

    config = load_config(options.config, options.set)
    text = parameters_page(config) if options.markdown else documented_yaml(config)
    if options.out is None:
        print(text, end="")
    else:
        write_atomically(options.out, text)
    return 0


if __name__ == "__main__":
    run_command(main)
