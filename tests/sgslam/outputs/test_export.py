"""What a run found of the building, in the files that BIM viewers open: the IFC copy and the BCF topics."""

import json
import shutil
import zipfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ifcopenshell
import ifcopenshell.util.element
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import numpy as np
import pytest
from report_samples import verdict
from small_ifc import STOREY, write_small_ifc

from data import SceneGraph, WallSurface
from data.common.errors import UserError
from data.ifc.bcf import Version
from data.ifc.deviations import write_as_built
from data.plans import load_bim
from sgslam.as_built.elements import ElementVerdict, Verdict
from sgslam.as_built.elements.files import write_elements
from sgslam.as_built.findings import BCF
from sgslam.as_built.unplanned.entries import UnplannedEntry
from sgslam.cli.export import IFC, export
from sgslam.config import Config
from sgslam.config.loading import save_config

SHARED_2X3 = Path(__file__).resolve().parents[4] / "shared/data/ifc/AC90R1-niedriha-V2-2x3.ifc"
YAW = 0.4
ENDS = ((3000.0, -1998.0), (3003.0, -1998.0))
Run = tuple[Path, Path, list[WallSurface]]


def on(surface: WallSurface, found: Verdict, offset: float | None = None) -> ElementVerdict:
    """The verdict on the wall of a surface."""
    outline = (*surface.ends(), *surface.ends()[::-1])
    return verdict(surface.source, found, offset, turn_rad=0.01, outline=outline, direction=(*surface.normal, 0.0))


@pytest.fixture(scope="module", params=[False, True], ids=["metres", "millimetres"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run's folder, as far as it is read, its model, which is turned and lies far from zero, and surfaces of it: of a
    wall that is moved, of an absent and of one that is as planned. The plan lacks a fourth. A door is not seen."""
    out = tmp_path_factory.mktemp("run")
    building = write_small_ifc(out / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=YAW, millimetres=request.param)
    graph = load_bim(building.path, out).graph
    moved, absent, stands = list({w.source: w for w in reversed(graph.wall_surfaces)}.values())[:3]
    door = ifcopenshell.open(str(building.path)).by_type("IfcDoor")[0].GlobalId
    graph.save(out / "a_graph.json")
    SceneGraph("map").save(out / "s_graph.json")
    verdicts = [on(moved, "moved", 0.15), on(absent, "absent"), on(stands, "as planned", -0.004)]
    verdicts.append(verdict(door, "not seen"))
    extra = UnplannedEntry("w9", "wall-like", "Hall", STOREY, ENDS, 3.0, (40.2, 42.3), (0.0, 1.0), ("w9",), "because")
    thing = replace(extra, id="w8", kind="furniture-like")
    write_elements(out, [asdict(own) for own in verdicts], 0.03, [asdict(own) for own in (extra, thing)])
    metrics = {"T_bim_map": [3000.0, -2000.0, 41.0, 0.0, 0.0, 0.0, 1.0]}
    for name, content in (("metrics", metrics), ("matches", {"floor": moved.floor}), ("deviations", [])):
        (out / f"{name}.json").write_text(json.dumps(content))
    (out / "config.yaml").write_text(save_config(Config()))
    said = "\n".join(export(out, ["ifc", "bcf"], building.path))
    assert "4 elements" in said and "3 topics" in said
    return out, building.path, [moved, absent, stands]


def as_built(path: Path, *names: str) -> list[dict[str, Any]]:
    """What the copy tells of elements; lengths are in metres."""
    copy = ifcopenshell.open(str(path))
    metre = ifcopenshell.util.unit.calculate_unit_scale(copy)
    found = [ifcopenshell.util.element.get_pset(copy.by_guid(name), "AsBuilt") for name in names]
    return [{k: v * metre if k.startswith("Offset") else v for k, v in own.items()} for own in found]


def test_walls_of_the_copy_tell_how_they_were_built(run: Run) -> None:
    out, _, surfaces = run
    copy = ifcopenshell.open(str(out / IFC))
    (door,) = (own.GlobalId for own in copy.by_type("IfcDoor") if ifcopenshell.util.element.get_pset(own, "AsBuilt"))
    moved, absent, stands, hidden = as_built(out / IFC, *(own.source for own in surfaces), door)
    assert [own["Status"] for own in (moved, absent, stands, hidden)] == ["moved", "absent", "as planned", "not seen"]
    offset = [moved[f"Offset{axis}"] for axis in "XYZ"]
    np.testing.assert_allclose(offset, [*(0.15 * np.array(surfaces[0].normal)), 0.0], atol=1e-7)
    assert [moved[name] for name in ("ShareSeen", "LevelOfAccuracy", "Conclusive", "Views")] == [0.85, "LOA30", True, 7]
    assert (moved["Coverage"], moved["Progress"], hidden["Progress"]) == (0.4, "installed", "not enough data")
    assert moved["Offset"] == pytest.approx(0.15) and moved["OffsetSigma"] == pytest.approx(0.005)
    assert moved["Turn"] == pytest.approx(0.01) and moved["Reason"] == "because"
    assert not {"Offset", "LevelOfAccuracy"} & absent.keys()
    (item,) = copy.by_guid(surfaces[0].source).Representation.Representations[0].Items
    assert item.StyledByItem[0].Styles[0].Name == "As built: moved"
    # all else is as it was: the same walls make the same A-graph
    graph, again = SceneGraph.load(out / "a_graph.json"), load_bim(out / IFC, out / "cache").graph
    assert again.wall_surfaces == graph.wall_surfaces and again.rooms == graph.rooms


def test_a_wall_that_the_plan_lacks_stands_in_the_copy(run: Run) -> None:
    copy = ifcopenshell.open(str(run[0] / IFC))
    (proxy,) = copy.by_type("IfcBuildingElementProxy")
    assert ifcopenshell.util.element.get_pset(proxy, "AsBuilt", "Status") == "unplanned"
    assert ifcopenshell.util.element.get_container(proxy).Name == STOREY
    metre = ifcopenshell.util.unit.calculate_unit_scale(copy)
    T = ifcopenshell.util.placement.get_local_placement(proxy.ObjectPlacement)
    np.testing.assert_allclose(T[:3, 3] * metre, [*ENDS[0], 40.2], atol=1e-6)
    solid = proxy.Representation.Representations[0].Items[0]
    assert solid.Depth * metre == pytest.approx(2.1)


@pytest.mark.parametrize("version", BCF)
def test_topics_name_the_walls_and_look_at_them(run: Run, version: Version) -> None:
    """Their elements are in the order of the schema."""
    reader = pytest.importorskip("bcf.bcfxml", reason="bcf-client is a development extra")
    out, _, (moved, absent, _) = run
    found = {}
    with reader.load(out / BCF[version]) as project:
        assert project.version.version_id == version
        for topic in project.topics.values():
            labels = topic.topic.labels
            (label,) = labels if isinstance(labels, list) else labels.label
            (view,) = (own.visualization_info for own in topic.viewpoints.values())
            camera, chosen = view.perspective_camera, view.components.selection
            place, ahead = (np.array([p.x, p.y, p.z]) for p in (camera.camera_view_point, camera.camera_direction))
            found[label] = [own.ifc_guid for own in chosen.component] if chosen else []
            for surface in (own for own in (moved, absent) if own.source in found[label]):
                away = np.subtract(surface.centroid, place[:2])  # the camera's middle ray meets the wall
                assert away[0] * ahead[1] - away[1] * ahead[0] == pytest.approx(0.0, abs=1e-3) and ahead[2] < 0
    assert found == {"moved": [moved.source], "absent": [absent.source], "extra": []}
    order = ["Title", "Index", "Labels", "CreationDate", "CreationAuthor", "Description", "Viewpoints"]
    with zipfile.ZipFile(out / BCF[version]) as archive:
        markups = [ElementTree.fromstring(archive.read(n)) for n in archive.namelist() if n.endswith("markup.bcf")]
    tags = order if version == "3.0" else order[:-1]
    assert [[own.tag for own in markup.iterfind("Topic/*")] for markup in markups] == [tags] * 3


def test_a_model_of_another_building_is_refused(run: Run, tmp_path: Path) -> None:
    shutil.copytree(run[0], tmp_path, dirs_exist_ok=True)
    (tmp_path / IFC).unlink()
    write_elements(tmp_path, [asdict(verdict("0" * 22, "moved", 0.1))], 0.03)
    with pytest.raises(UserError, match="none of the elements"):
        export(tmp_path, ["ifc"], run[1])
    assert not (tmp_path / IFC).exists()


@pytest.mark.skipif(not SHARED_2X3.exists(), reason="the shared data is not there")
def test_models_of_the_older_schema_too(tmp_path: Path) -> None:
    wall = ifcopenshell.open(str(SHARED_2X3)).by_type("IfcWall")[0]
    assert write_as_built(SHARED_2X3, [asdict(verdict(wall.GlobalId, "moved", 0.1))], [], tmp_path / "copy.ifc") == 1
    (told,) = as_built(tmp_path / "copy.ifc", wall.GlobalId)
    assert told["Offset"] == pytest.approx(0.1)
    copy = ifcopenshell.open(str(tmp_path / "copy.ifc"))
    shapes = copy.by_guid(wall.GlobalId).Representation.Representations
    (body,) = (own for own in shapes if own.RepresentationIdentifier == "Body")
    assert body.Items[0].StyledByItem[0].Styles[0].Styles[0].Name == "As built: moved"
