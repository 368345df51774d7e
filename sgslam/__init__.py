"""Indoor LiDAR SLAM that knows the building's plans.

    slam = SceneGraphSlam(bim=load_bim("building.ifc"))
    for stamp_ns, points in scans:
        update = slam.add_scan(stamp_ns, points)
    slam.finish().save("out")

`__all__` lists the public names. Each is loaded on first use, so that importing the package takes no time.
"""

import importlib
from typing import TYPE_CHECKING

from sgslam.own_packages import foreign_package

if TYPE_CHECKING:
    from data.common.errors import UserError as UserError
    from data.plans import load_bim as load_bim
    from data.scene_graph import SceneGraph as SceneGraph
    from matching.matcher import Matcher as Matcher
    from sgslam.config import Config as Config
    from sgslam.live.live_slam import LiveSlam as LiveSlam
    from sgslam.odometry.kiss import KissOdometry as KissOdometry
    from sgslam.result import Result as Result
    from sgslam.slam import SceneGraphSlam as SceneGraphSlam
    from sgslam.types import Update as Update

    __version__: str

_MODULES = {
    "Config": "sgslam.config",
    "KissOdometry": "sgslam.odometry.kiss",
    "LiveSlam": "sgslam.live.live_slam",
    "Matcher": "matching.matcher",
    "Result": "sgslam.result",
    "SceneGraph": "data.scene_graph",
    "SceneGraphSlam": "sgslam.slam",
    "Update": "sgslam.types",
    "UserError": "data.common.errors",
    "load_bim": "data.plans.bim",
}
__all__ = list(_MODULES)

for _name in ("data", "matching", "factors"):
    if _message := foreign_package(_name):
        raise ImportError(_message)

if not TYPE_CHECKING:  # a type checker that sees __getattr__ takes every name for Any

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version  # slow to load

            value = version("sgslam")
        elif name in _MODULES:
            value = getattr(importlib.import_module(_MODULES[name]), name)
        else:
            raise AttributeError(f"module 'sgslam' has no attribute '{name}'")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
