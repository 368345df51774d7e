"""How well the pose of each scan is known, and whether it is anchored."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from data.common.files import write_atomically
from data.trajectory.stamps import ns_to_seconds
from sgslam.backend import Uncertainty
from sgslam.config import Config, OdometrySettings, QualitySettings
from sgslam.session.active_map import ActiveMap
from sgslam.session.prior_map import PriorMap
from sgslam.session.scan_poses import ScanPose

Floats = NDArray[np.float64]
FILE = "trajectory_sigma.csv"
_OWN = (1.5 / 6.0) ** 2  # share of a tracked pose's variance that is its own: of 6 median residuals, noise explains 1.5
_MOST = 100  # keyframes whose covariance is computed; between them it is interpolated
_HEADER = (
    "stamp_s,sigma_x_m,sigma_y_m,sigma_z_m,sigma_roll_deg,sigma_pitch_deg,sigma_yaw_deg,part,floor,probability,"
    "anchored,health"
)


@dataclass(frozen=True, eq=False)
class ScanUncertainty:
    """The uncertainty of each scan's pose, in the order of the scans' stamps (N,), in nanoseconds.

    `sigma` (N, 6): standard deviations along x, y, z (m) and about x, y, z (rad) in the trajectory's frame; NaN where
    they are unknown, as in a part whose scans are all lost. `part` (N,): 0 for the map, then a number for each submap
    that was not relocalised, whose sigmas are in its own frame. `floor` (N,): ids of the S-graph's floors, empty
    between two floors. `probability` (N,): that the map's place in the building is right, and the pose's errors along
    and about all axes are within the limits of the settings `quality`; 0 for lost scans and where the map has no place.
    `anchored` (N,): whether that is as probable as the settings demand. `health` (N,) is the tracker's verdict.
    """

    stamps_ns: NDArray[np.int64]
    sigma: Floats
    part: NDArray[np.int64]
    floor: NDArray[np.str_]
    probability: Floats
    anchored: NDArray[np.bool_]
    health: NDArray[np.str_]

    @staticmethod
    def joined(parts: "list[ScanUncertainty]") -> "ScanUncertainty":
        """All parts in the order of their stamps."""
        whole = ScanUncertainty(*(np.concatenate([getattr(own, f.name) for own in parts]) for f in fields(parts[0])))
        return whole.only(np.argsort(whole.stamps_ns, kind="stable"))

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "ScanUncertainty":
        """The chosen scans, by a mask (N,) or by number."""
        return ScanUncertainty(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @property
    def seconds(self) -> Floats:
        """(N,) since the first scan."""
        return np.asarray((self.stamps_ns - self.stamps_ns[:1]) / 1e9)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """(N,) whether the scan did not fit the map, so that its pose is predicted."""
        return np.asarray(self.health == "lost")

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) whether the scan is neither lost nor in a part that was not placed."""
        return ~self.lost & (self.part == 0)

    def write_csv(self, path: Path) -> None:
        """Writes the file `trajectory_sigma.csv`; angles in degrees."""
        values = np.hstack([self.sigma[:, :3], np.degrees(self.sigma[:, 3:])])
        judged = [f"{p:.4f},{anchored:d}" for p, anchored in zip(self.probability, self.anchored, strict=True)]
        rows = zip(self.stamps_ns, values, self.part, self.floor, judged, self.health, strict=True)
        lines = [
            ",".join([ns_to_seconds(int(stamp)), *(f"{v:.5g}" for v in own), *map(str, others)])
            for stamp, own, *others in rows
        ]
        write_atomically(path, "\n".join([_HEADER, *lines, ""]))


def scan_uncertainty(
    final: ActiveMap | PriorMap,
    begin: int,
    uncertainty: Uncertainty | None,
    T_bim_map: Floats | None,
    config: Config,
    part: int = 0,
) -> ScanUncertainty:
    """Of a map's scans from number `begin` on, along the axes of the building where the map's place T_bim_map (4, 4) is
    known, else of the map.

    A pose is as uncertain as the keyframes around it, what it was tracked worse than the one before, its own noise, and
    what a step between the two errs on the way: a Brownian bridge.
    """
    # a part that joined the map late may be from before the others
    own, keyframes = sorted(final.scans[begin:], key=lambda scan: scan.stamp_ns), final.backend.keyframes
    R_frame_map = np.eye(3) if T_bim_map is None else T_bim_map[:3, :3]
    stamps = np.array([scan.stamp_ns for scan in own], dtype=np.int64)
    floors = [keyframes[scan.keyframe].storey for scan in own]
    named = np.array(["" if floor is None else f"floor-{floor}" for floor in floors])
    sigma, health = np.full((len(own), 6), np.nan), np.array([scan.health for scan in own])
    is_lost = health == "lost"
    if uncertainty is not None and not is_lost.all():
        sigma[:] = np.sqrt(_variances(final, own, uncertainty, R_frame_map, config.odometry))
    probability = (T_bim_map is not None) * ~is_lost * probability_within(sigma, _limits(config.quality))
    anchored, part_of = probability >= config.quality.anchored_probability, np.full(len(own), part)
    return ScanUncertainty(stamps, sigma, part_of, named, probability, anchored, health)


def probability_within(sigma: Floats, limits: Floats) -> Floats:
    """(N,) the probability that all six errors, normal with `sigma` (N, 6), are within their `limits` (6,) at once; 0
    where a sigma is NaN.

    It is exact for independent errors and a lower bound for correlated ones (Sidak, "Rectangular confidence regions for
    the means of multivariate normal distributions", J. Am. Stat. Assoc. 62, 1967).
    """
    return np.nan_to_num(np.prod(erf(limits / (np.sqrt(2) * sigma)), axis=1))


def what_is_not_anchored(own: ScanUncertainty) -> str:
    """The scans without an anchored pose, counted by cause; empty where there are none."""
    lost, apart = own.lost, own.part > 0
    counts = {
        "are lost": lost,
        "are in parts that were not placed": apart & ~lost,
        "have poses that are too uncertain": ~own.anchored & ~apart & ~lost,
    }
    texts = [f"{own.sum()} {cause}" for cause, own in counts.items() if own.any()]
    return f"of {len(lost)} scans {', '.join(texts)}" if texts else ""


def _limits(settings: QualitySettings) -> Floats:
    """(6,) the errors (m, rad) that anchored poses have at most, with the probability of the settings."""
    return np.repeat([settings.anchored_position, np.radians(settings.anchored_attitude)], 3)


def why_none_is_anchored(own: ScanUncertainty, settings: QualitySettings) -> str:
    """One line, of a map that fits the plan at one place, with the setting that limits what is known worst."""
    known = own.sigma[~own.lost]
    if not len(known):
        return "the map fits the plan, but every scan is lost"
    sigma = np.median(known, axis=0)
    if not np.isfinite(sigma).all():
        return "the map fits the plan, but the uncertainty of its poses cannot be computed"
    worst = int(np.argmax(sigma / _limits(settings)))
    what = ("position along x", "position along y", "height", "roll", "pitch", "heading")[worst]
    known_to = f"{sigma[worst]:.2f} m" if worst < 3 else f"{np.degrees(sigma[worst]):.2f} degrees"
    limit = "quality.anchored_position" if worst < 3 else "quality.anchored_attitude"
    why = f"its {what} is too uncertain: the standard deviation is {known_to}"
    return f"the map fits the plan, but {why}; {limit} limits it"


def _variances(
    final: ActiveMap | PriorMap,
    own: list[ScanPose],
    uncertainty: Uncertainty,
    R_frame_map: Floats,
    settings: OdometrySettings,
) -> Floats:
    """(N, 6) along and about the axes of the frame."""
    scans, keyframes = final.scans, final.backend.keyframes
    used = np.array(sorted({scan.keyframe for scan in own}, key=lambda k: keyframes[k].stamp_ns))
    chosen = used[np.unique(np.linspace(0, len(used) - 1, min(len(used), _MOST)).astype(int))]
    R_frame_keyframe = R_frame_map @ final.backend.poses[:, :3, :3]
    known = _along_axes(uncertainty.pose_covariances(chosen.tolist()), R_frame_keyframe[chosen])
    began = own[0].stamp_ns
    at = np.array([keyframes[k].stamp_ns - began for k in chosen], dtype=np.float64)
    when = np.array([scan.stamp_ns - began for scan in own], dtype=np.float64)
    variances = np.column_stack([np.interp(when, at, column) for column in known.T])
    of, parts = (np.array([getattr(scan, name) for scan in own]) for name in ("keyframe", "T_keyframe_sensor"))
    tracked = _along_axes(np.stack([scan.covariance for scan in own]), R_frame_keyframe[of] @ parts[:, :3, :3])
    before = _along_axes(np.stack([scans[keyframes[k].scan].covariance for k in of]), R_frame_keyframe[of])
    step = np.repeat([settings.sigma_translation, settings.sigma_rotation], 3) ** 2
    at_all = np.array([keyframe.stamp_ns - began for keyframe in keyframes], dtype=np.float64)
    lasts = at_all[np.minimum(of + 1, len(keyframes) - 1)] - at_all[of]
    share = np.clip((when - at_all[of]) / np.maximum(lasts, 1.0), 0.0, 1.0)
    alone = np.maximum(tracked - before, _OWN * tracked)
    return np.asarray(variances + alone + (share * (1 - share))[:, None] * step)


def live_sigma(known: ActiveMap, T_map_sensor: Floats, covariance: Floats, settings: OdometrySettings) -> Floats:
    """(6,) the standard deviations of the newest pose (4, 4), tracked with a covariance (6, 6), along (m) and about
    (rad) the axes of the building where the map is anchored, else of the map; NaN before the first optimisation.

    The pose is as uncertain as the newest keyframe of that optimisation, and what it was tracked worse since then.
    """
    backend, T_bim_map = known.backend, known.T_bim_map
    newest, uncertainty = backend.newest_in_optimum, backend.uncertainty()
    R_frame_map = np.eye(3) if T_bim_map is None else T_bim_map[:3, :3]
    if newest is None or uncertainty is None:
        return np.full(6, np.nan)
    keyframe, steps = backend.keyframes[newest], len(backend.keyframes) - 1 - newest
    R_frame_keyframe = (R_frame_map @ keyframe.T_map_sensor[:3, :3])[None]
    optimised = _along_axes(uncertainty.pose_covariances([newest]), R_frame_keyframe)
    before = _along_axes(known.scans[keyframe.scan].covariance[None], R_frame_keyframe)
    tracked = _along_axes(covariance[None], (R_frame_map @ T_map_sensor[:3, :3])[None])
    step = np.repeat([settings.sigma_translation, settings.sigma_rotation], 3) ** 2
    return np.asarray(np.sqrt(optimised + np.maximum(tracked - before, _OWN * tracked) + steps * step)[0])


def _along_axes(covariances: Floats, R: Floats) -> Floats:
    """(N, 6) variances along, then about the axes to which R (N, 3, 3) turns, of covariances (N, 6, 6)."""
    along, about = (np.einsum("nij,njk,nik->ni", R, covariances[:, own, own], R) for own in (slice(3, 6), slice(3)))
    return np.hstack([along, about])
