"""Open3D, which needs a system library that many machines lack."""

import ctypes
import importlib
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from data.common.errors import UserError


def load_open3d() -> Any:
    """The module `open3d`. Its libusb is taken from the extra's package, so that none has to be installed.

    Raises UserError where it is not installed or cannot be loaded.
    """
    if find_spec("open3d") is None:
        raise UserError("Open3D is not installed; pip install 'sgslam[open3d]'")
    _preload_libusb()
    try:
        return importlib.import_module("open3d")
    except ImportError as error:
        what = "; it needs libusb-1.0, libGL and libgomp of the system"
        raise UserError(f"Open3D cannot be loaded ({error}){what}") from None


def _preload_libusb() -> None:
    """A library that is loaded already is found by its name."""
    package = find_spec("libusb_package")
    if package is not None and package.origin is not None:
        with suppress(OSError):  # the system's own counts then
            ctypes.CDLL(str(Path(package.origin).with_name("libusb-1.0.so")), mode=ctypes.RTLD_GLOBAL)
