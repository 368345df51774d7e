"""sgslam as a pipeline of evalio (github.com/contagon/evalio), beside its other odometries. Needs the extra `evalio`.

EVALIO_CUSTOM=sgslam.evalio_pipeline evalio run -d DATASET/SEQUENCE -p kiss -p sgslam -o results
"""

from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.evalio import points_in_reach

if TYPE_CHECKING:
    from sgslam.config import Config
    from sgslam.slam import SceneGraphSlam

with suppress(ImportError):  # rerun 0.41 recurses without end where evalio asks it for them before they are loaded
    import rerun.datatypes  # noqa: F401
_Pipeline: Any = object
with suppress(ImportError):  # without the extra, nothing looks for the class
    from evalio import pipelines

    _Pipeline = pipelines.Pipeline

Floats = NDArray[np.float64]


class SgslamPipeline(_Pipeline):  # type: ignore[misc]
    """Tracks a sequence; each saved pose is T_map_imu, as it was known right after its scan.

    Parameters: `plan`, a building's plan that the map is anchored to; `config`, settings as YAML; `use_imu`. The poses
    stay in the map's frame with a plan too. Those of the first seconds are saved once the direction of gravity is
    known. A sensor that was carried elsewhere begins a new map: its poses jump.
    """

    def __init__(self) -> None:
        super().__init__()
        self._params = self.default_params()
        self._limits: Any = None
        self._T_lidar_imu: Any = None
        self._slam: SceneGraphSlam
        self._waiting_ns: int | None = None

    @staticmethod
    def name() -> str:
        """The name for `evalio run -p`."""
        return "sgslam"

    @staticmethod
    def version() -> str:
        """The installed version of sgslam."""
        return version("sgslam")

    @staticmethod
    def url() -> str:
        """No page of its own."""
        return "-"

    @staticmethod
    def default_params() -> dict[str, bool | int | float | str]:
        """All parameters; an empty path means none."""
        return {"plan": "", "config": "", "use_imu": True}

    def set_params(self, params: dict[str, Any]) -> dict[str, Any]:
        """Takes the parameters that are known and returns the others."""
        self._params |= {name: value for name, value in params.items() if name in self._params}
        return {name: value for name, value in params.items() if name not in self._params}

    def set_imu_params(self, params: Any) -> None:
        """Not used: the settings `imu` say how an IMU errs."""

    def set_lidar_params(self, params: Any) -> None:
        """The ranges within which points are used."""
        self._limits = params

    def set_imu_T_lidar(self, T: Any) -> None:  # noqa: N802
        """The LiDAR in the IMU's frame."""
        self._T_lidar_imu = T.inverse()

    def initialize(self) -> None:
        """Loads the settings and the plan, and compiles: evalio measures the time from the first scan on. Raises
        UserError if they cannot be read."""
        from threadpoolctl import threadpool_limits

        from data.plans import load_bim
        from matching import Matcher
        from sgslam.slam import SceneGraphSlam
        from sgslam.warm_up import compile_ahead

        threadpool_limits(1, user_api="blas")
        compile_ahead()
        config = self._config()
        plan = self._path("plan")
        bim = None if plan is None else load_bim(plan)
        matcher = None if bim is None else Matcher.load(config.matching.method)
        compile_ahead().wait()
        self._slam = SceneGraphSlam(bim, matcher, config)

    def _path(self, name: str) -> Path | None:
        return Path(str(self._params[name])) if self._params[name] else None

    def _config(self) -> "Config":
        from scipy.spatial.transform import Rotation

        from sgslam.config.loading import load_config

        config = load_config(self._path("config"), [])
        R_lidar_imu = self._T_lidar_imu.rot.to_mat()
        turns = tuple(Rotation.from_matrix(R_lidar_imu).as_euler("xyz", degrees=True).tolist())
        return config.model_copy(update={"imu": config.imu.model_copy(update={"rotation": turns})})

    def add_imu(self, mm: Any) -> None:
        """Adds a sample of the IMU. One that cannot be used, such as a repeated one, is left out."""
        if not self._params["use_imu"]:
            return
        with suppress(UserError):
            self._slam.add_imu(mm.stamp.to_nsec(), mm.gyro, mm.accel)

    def add_lidar(self, mm: Any) -> None:
        """Adds a scan and saves the poses that it made known. A scan that cannot be used gets no pose."""
        points, times = points_in_reach(mm, self._limits)
        stamp_ns = mm.stamp.to_nsec()
        try:
            update = self._slam.add_scan(stamp_ns, points, times)
        except UserError as error:
            print(f"scan at {stamp_ns} ns is left out: {error}")
            return
        if update.health is None:
            self._waiting_ns = stamp_ns if self._waiting_ns is None else self._waiting_ns
            return
        if self._waiting_ns is not None:
            known = self._slam.live_poses(self._waiting_ns)
            for stamp, T_map_sensor in zip(known.stamps_ns.tolist(), known.poses, strict=True):
                if stamp < stamp_ns:
                    self._save(stamp, T_map_sensor)
            self._waiting_ns = None
        self._save(stamp_ns, update.T_map_sensor)

    def _save(self, stamp_ns: int, T_map_sensor: Floats) -> None:
        from evalio.types import SE3, Stamp

        self.save(Stamp.from_nsec(stamp_ns), SE3.from_mat(np.asfortranarray(T_map_sensor)) * self._T_lidar_imu)

    def map(self) -> dict[str, Any]:
        """No map is shown."""
        return {}
