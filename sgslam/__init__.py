"""Indoor LiDAR SLAM that knows the building's plans.

    slam = SceneGraphSlam(bim=load_bim("building.ifc"))
    for stamp_ns, points in scans:
        update = slam.add_scan(stamp_ns, points)
    slam.finish().save("out")
"""

import importlib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_HOMES = {
    "Config": "sgslam.config", "KissOdometry": "sgslam.odometry.kiss", "Result": "sgslam.session.result",
    "SceneGraph": "data.scene_graph", "SceneGraphSlam": "sgslam.slam", "Update": "sgslam.session.result",
    "load_bim": "data.plans.bim",
}  # fmt: skip
__all__ = [*_HOMES]


def _check_siblings() -> None:
    """Raises ImportError where another package of the same name stands before one of ours."""
    here = Path(__file__).resolve().parent.parent
    for name in ("data", "matching", "factors", "evaluation"):
        found = _origin(name)
        if found != here / name / "__init__.py":
            raise ImportError(
                f"sgslam needs its own package '{name}' from {here}, but Python finds "
                f"{'none' if found is None else 'another, ' + str(found)}; run in an environment or folder without it"
            )


def _origin(name: str) -> Path | None:
    try:
        spec = find_spec(name)
    except ValueError:  # somebody put a module of no origin in its place
        return None
    return Path(spec.origin).resolve() if spec is not None and spec.origin else None


def __getattr__(name: str) -> Any:
    # loaded on first use: importing the package costs nothing that --help would feel
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'sgslam' has no attribute '{name}'")


_check_siblings()
