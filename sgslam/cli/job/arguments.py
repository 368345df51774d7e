"""Arguments of the commands that run on scans: poses, settings, and the folder for the results."""

import argparse
import math
from datetime import datetime
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.scans.point_times import Stamped
from sgslam.as_built.elements.tolerance_classes import parse_length
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.odometry.external import ExternalOdometry
from sgslam.odometry.factory import choose
from sgslam.session.result import prepare_folder

Start = tuple[float, float, float]
_TURN = 360.0  # degrees


def read_config(
    options: argparse.Namespace, resumed: dict[str, Any] | None = None
) -> tuple[Config, ExternalOdometry | None]:
    """The settings that the options give, else those of the run to be resumed, and the external odometry if there is
    one. Raises UserError."""
    if resumed is None or options.config is not None or options.set:
        config = load_config(options.config, options.set)
    else:
        config = Config.model_validate(resumed["config"])
    config, external = (config, None) if options.odometry is None else choose(options.odometry, config)
    if options.mount is not None:
        mount = three_numbers("--mount", options.mount, "ROLL,PITCH,YAW (degrees)", "0,25,0")
        config = config.model_copy(update={"tracking": config.tracking.model_copy(update={"mount": mount})})
    if options.stamp is not None:
        config = with_stamp(config, options.stamp)
    if options.tolerance is not None:
        as_built = config.as_built.model_copy(update={"tolerance": parse_length(options.tolerance)})
        config = config.model_copy(update={"as_built": as_built})
    return config, external


def with_stamp(config: Config, stamped: Stamped) -> Config:
    """The settings, where stamps name that instant of a scan."""
    return config.model_copy(update={"tracking": config.tracking.model_copy(update={"stamp": stamped})})


def read_start(text: str) -> Start:
    """The pose that `--start` gives. Raises UserError."""
    return three_numbers("--start", text, "X,Y,YAW", "3.5,-1.2,1.57")


def three_numbers(option: str, text: str, form: str, example: str) -> tuple[float, float, float]:
    """The numbers of an option such as `--start X,Y,YAW`. Raises UserError."""
    try:
        a, b, c = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(f"{option} {text}: not in the form {form}; write e.g. {example}") from None
    if not all(math.isfinite(value) for value in (a, b, c)):
        raise UserError(f"{option} {text}: {form} must be finite numbers; write e.g. {example}")
    if option == "--start" and abs(c) > 2 * math.pi:
        raise UserError(f"{option} {text}: the yaw is in radians; {c:g} degrees are {math.radians(c):.4f}")
    if option == "--mount" and max(abs(a), abs(b), abs(c)) > _TURN:
        raise UserError(f"{option} {text}: give roll, pitch and yaw in degrees, each from -360 to 360")
    return a, b, c


def out_folder(options: argparse.Namespace) -> Path:
    """The folder for the results, created if needed. Raises UserError if it cannot be written to."""
    return prepare_folder(options.out or default_out())


def default_out() -> Path:
    """The folder for the results of a run that begins now."""
    return Path("out") / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
