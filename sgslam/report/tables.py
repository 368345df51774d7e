"""The rows of the report's tables: summary, quality and hypotheses."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from data.scene_graph import Georeference
from sgslam.as_built.deviation_bands import MINUS
from sgslam.config import AnchorSettings
from sgslam.report.contents import ReportData
from sgslam.report.number_formats import NOTHING, metres, percent, seconds, signal_texts, thousands
from sgslam.types import NO_PLAN

_RIVALS = {
    "runner_up": "the next best",
    "mirrored": "that it is mirrored",
    "outside": "none of the places",
    "unsound": "that the map is not sound",
}


def badge(metrics: dict[str, Any]) -> str:
    """Whether the run is anchored, in part, or not; or had no plan."""
    share = metrics.get("anchored_share", 1.0)
    if not metrics.get("anchored"):
        return "map only" if metrics.get("reason") == NO_PLAN else "not anchored"
    return "anchored" if share == 1.0 else f"anchored in part: {100 * share:.1f} % of the scans"


def quality_rows(metrics: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Phrase, value and limit of each signal of the map's quality, and whether it is within the limit."""
    rows = []
    for name, own in (metrics.get("quality") or {}).items():
        within = ", but ".join(filter(None, ("within", doubt(metrics) if name == "place_probability" else "")))
        rows.append((*signal_texts(name, own), within if own["ok"] else "outside its limit"))
    return rows


def doubt(metrics: dict[str, Any]) -> str:
    """What speaks most against the place of an anchored run; empty where it is as probable as a commitment asks for."""
    place = metrics.get("place")
    if not metrics.get("anchored") or place is None or place["probability"] >= AnchorSettings().commit:
        return ""
    rivals = _rivals(place)
    most = max(rivals, key=rivals.__getitem__)
    against = {name: own["nats"] for name, own in place["signals"].items() if (own["nats"] or 0.0) < 0}
    why = f", by {min(against, key=against.__getitem__).replace('_', ' ')}" if most == "unsound" and against else ""
    return f"the place is not certain: {_RIVALS[most]} {percent(rivals[most])}{why}"


def _rivals(place: Mapping[str, float]) -> dict[str, float]:
    """The probability of all else than the place that was found, by the names of _RIVALS."""
    return {name: {**place, "unsound": 1 - place["sound"]}[name] for name in _RIVALS}


def run_rows(metrics: dict[str, Any]) -> dict[str, str]:
    """Value by name of the figures of a run that metrics.json has."""
    counts = {name: thousands(metrics.get(name)) for name in ("scans", "scans_skipped", "keyframes")}
    rows = {"Scans": f"{counts['scans']} ({counts['scans_skipped']} skipped), {counts['keyframes']} keyframes"}
    if tracked := metrics.get("tracked"):
        rows["Tracking"] = ", ".join(f"{thousands(count)} {health}" for health, count in tracked.items())
    if place := metrics.get("place"):
        others = [f"{_RIVALS[name]} {percent(value)}" for name, value in _rivals(place).items() if value >= 0.0005]
        rows["Probability of the place"] = "; ".join([percent(place["probability"]), *others])
    if signal := (metrics.get("quality") or {}).get("position_sigma_m"):
        whose = "anchored positions" if metrics.get("anchored") else "positions"
        rows[f"95 % of the {whose}"] = f"have a standard deviation of at most {metres(signal['value'])}"
    if outcome := metrics.get("returned"):
        when = "" if outcome["found_s"] is None else f"{outcome['found_s']:.1f} s after the last part began: "
        rows["Relocalisation"] = f"{when if outcome['found'] else 'the last part was not placed: '}{outcome['reason']}"
    if metrics.get("first_anchor_s") is not None:
        rows["First anchored after"] = seconds(metrics["first_anchor_s"])
    if check := metrics.get("held_out"):
        worst, share = check["worst"], f"{100 * check['within_95']:.0f} % within 1.96 standard deviations"
        off = f"{metres(worst['offset_m'])} \N{PLUS-MINUS SIGN} {metres(worst['sigma_m'])} at {worst['a_id']}"
        rows[f"{check['walls']} walls, held out of the map"] = (
            f"{metres(check['rms_m'])} off the plan (RMS), {share}; worst {off}"
        )
    if known := metrics.get("georeference"):
        rows["Map coordinates"] = str(Georeference(**known))
    return rows | _accuracy_rows(metrics.get("accuracy") or {})


def control_rows(metrics: dict[str, Any]) -> list[tuple[str, ...]]:
    """Each control point with how far the map has it off along x, y and z, its standard deviation, and whether it
    contradicts the rest."""
    rows = []
    for own in metrics.get("control") or ():
        off = (metres(along).replace("-", MINUS) for along in own["residual_m"])
        rows.append((own["name"], *off, metres(own["sigma_m"]), "contradicts the rest" if own["contradicts"] else ""))
    return rows


def summary_rows(data: ReportData) -> list[tuple[str, str]]:
    """Name and value of the figures of the whole run: those of `run_rows`, how many scans were lost or are in parts
    that were not placed, if any, and the way."""
    rows = run_rows(data.metrics)
    if data.scans is not None:
        apart = data.scans.part > 0
        if lost := int((data.scans.lost & ~apart).sum()):
            rows["Lost scans"] = thousands(lost)
        if apart.any():
            when = data.scans.seconds[apart]
            span = f"between {when.min():.1f} and {when.max():.1f} s; they are not drawn"
            rows["Scans in parts not placed"] = f"{thousands(int(apart.sum()))}, {span}"
    rows["Distance travelled"] = f"{data.trajectory_map.length:.1f} m"
    return list(rows.items())


def _accuracy_rows(accuracy: dict[str, Any]) -> dict[str, str]:
    """Value by name of each error against the ground truth that is known."""
    if not accuracy:
        return {}
    yaw = accuracy.get("yaw_rmse_bim_deg")
    rows = {
        "RMSE in the BIM frame, without alignment": metres(accuracy.get("rmse_bim_m")),
        "Maximum error in the BIM frame": metres(accuracy.get("max_bim_m")),
        "RMSE of the yaw": NOTHING if yaw is None else f"{yaw:.2f}°",
        "RMSE of the map's trajectory, SE(3)-aligned": metres(accuracy.get("rmse_map_aligned_m")),
        "RMSE of the odometry, SE(3)-aligned": metres(accuracy.get("rmse_odometry_aligned_m")),
        "Poses with ground truth": " of ".join(thousands(accuracy.get(f"{k}_poses")) for k in ("matched", "total")),
        "Note on accuracy": str(accuracy.get("note") or NOTHING),
    }
    return {name: text for name, text in rows.items() if text != NOTHING}


def hypothesis_rows(
    hypotheses: Sequence[Mapping[str, Any]], storeys: Mapping[str, str]
) -> list[tuple[str, str, str, str, str]]:
    """Storey, probability, score, pose of the map's origin, number of the plan's rooms that are matched; `storeys` are
    the names of the plan's by id."""
    rows = []
    for hypothesis in hypotheses:
        storey = str(hypothesis.get("floor") or "the plan")
        yaw, x, y = hypothesis["T_a_s"]
        turn = (math.degrees(yaw) + 180) % 360 - 180
        numbers = f"{hypothesis['score']:.1f}", f"{x:.2f}, {y:.2f} m, {turn:.1f}°"
        score, place = (text.replace("-", MINUS) for text in numbers)
        rooms, likely = {a_id for _, a_id in hypothesis.get("rooms") or ()}, hypothesis.get("probability")
        share = NOTHING if likely is None else percent(likely)
        rows.append((storeys.get(storey, storey), share, score, place, str(len(rooms))))
    return rows
