"""Compiles what a run needs before its first scan, once per installed version."""

import sys
from functools import partial
from threading import Timer
from typing import Any

from data.common.compiling import once_on_two_cores
from matching.matcher import make_ready
from sgslam.odometry.self_test import register

_SILENT = 5.0  # s without output, after which a message explains the delay


def compile_ahead(matcher: Any, method: str | None) -> None:
    """Makes a matcher, which was loaded by the name `method`, and the odometry ready; only the odometry for None."""
    message = "compiling, once per installed version: this takes half a minute or more"
    notice = Timer(_SILENT, print, [message], {"file": sys.stderr})
    notice.start()
    try:
        if method is None:
            register()
            return
        once_on_two_cores("run", partial(make_ready, matcher, method), register)
        make_ready(matcher, method)
    finally:
        notice.cancel()
