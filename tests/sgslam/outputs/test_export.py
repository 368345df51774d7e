"""What a run found of the building, in the files that BIM viewers open: the IFC copy and the BCF topics."""

import json
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ifcopenshell
import ifcopenshell.util.element
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import numpy as np
import pytest
from commands import called
from report_samples import verdict
from small_ifc import STOREY, write_small_ifc

from data import Floor, SceneGraph, WallSurface
from data.common.errors import UserError
from data.ifc.bcf import Version
from data.ifc.deviations import ElementFinding, write_as_built
from data.plans import load_bim
from sgslam.as_built.elements.files import write_elements
from sgslam.as_built.findings import BCF
from sgslam.cli.export import IFC, export
from sgslam.config import Config
from sgslam.config.loading import save_config

SHARED_2X3 = Path(__file__).resolve().parents[4] / "shared/data/ifc/AC90R1-niedriha-V2-2x3.ifc"
YAW = 0.4


def entry(kind: str, surface: WallSurface | None, offset: float | None = None, **more: Any) -> dict[str, Any]:
    source, a_id = ("", None) if surface is None else (surface.source, surface.id)
    known = {"tilt_rad": 0.01, "sigma_m": 0.005} if offset is not None else {"tilt_rad": None, "sigma_m": None}
    told = {"s_id": None, "a_id": a_id, "source": source, "kind": kind, "offset_m": offset, "significant": True}
    return told | known | {"reason": "because"} | more


@pytest.fixture(scope="module", params=[False, True], ids=["metres", "millimetres"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run's folder, as far as it is read, and its model, which is turned and lies far from zero: one wall moved, one
    absent, one as planned, one side of a wall that the plan lacks."""
    out = tmp_path_factory.mktemp("run")
    building = write_small_ifc(out / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=YAW, millimetres=request.param)
    graph = load_bim(building.path, out).graph
    walls = {s: next(w for w in graph.wall_surfaces if w.source == s) for s in
             dict.fromkeys(w.source for w in graph.wall_surfaces)}  # fmt: skip
    moved, absent, stands = list(walls.values())[:3]
    extra = WallSurface("w9", None, (1.0, 2.0), (0.0, 1.0), 3.0, "floor-0", height=(0.1, 2.2))
    graph.save(out / "a_graph.json")
    SceneGraph("map", (), (extra,), (), (Floor("floor-0", "", -0.8),)).save(out / "s_graph.json")
    deviations = [
        entry("moved", moved, 0.15), entry("moved", moved, 0.01, significant=False), entry("absent", absent),
        entry("moved", stands, -0.004, significant=False, reason="as planned"),
        entry("extra", None, s_id="w9"),
    ]  # fmt: skip
    (out / "deviations.json").write_text(json.dumps(deviations))
    pose = [3000.0, -2000.0, 41.0, 0.0, 0.0, np.sin(YAW / 2), np.cos(YAW / 2)]
    (out / "metrics.json").write_text(json.dumps({"T_bim_map": pose}))
    (out / "matches.json").write_text(json.dumps({"floor": moved.floor}))
    (out / "config.yaml").write_text(save_config(Config()))
    done = called("sgslam.cli.export", "--out", out, "--bim", building.path)
    assert done.returncode == 0, done.stderr
    assert "3 elements" in done.stdout and "3 topics" in done.stdout
    return out, building.path


def test_walls_of_the_copy_tell_how_they_were_built(run: tuple[Path, Path]) -> None:
    out, bim = run
    copy, graph = ifcopenshell.open(str(out / IFC)), SceneGraph.load(out / "a_graph.json")
    metre = ifcopenshell.util.unit.calculate_unit_scale(copy)
    sources = list(dict.fromkeys(w.source for w in graph.wall_surfaces))
    told = [ifcopenshell.util.element.get_pset(copy.by_guid(s), "AsBuilt") for s in sources]
    assert [t and t["Status"] for t in told] == ["moved", "absent", "as planned", *[None] * (len(told) - 3)]
    normal = next(w.normal for w in graph.wall_surfaces if w.source == sources[0])
    np.testing.assert_allclose([told[0]["OffsetX"], told[0]["OffsetY"]], 0.15 * np.array(normal) / metre, rtol=1e-6)
    assert told[0]["Offset"] * metre == pytest.approx(0.15) and told[0]["OffsetSigma"] * metre == pytest.approx(0.005)
    assert told[0]["Turn"] == pytest.approx(0.01) and told[0]["Reason"] == "because"
    assert "Offset" not in told[1]
    styled = {
        s: [style.Name for item in copy.by_guid(s).Representation.Representations[0].Items
            for own in item.StyledByItem for style in own.Styles]
        for s in sources[:3]
    }  # fmt: skip
    assert list(styled.values()) == [["As built: moved"], ["As built: absent"], ["As built: as planned"]]
    # all else is as it was: the same walls make the same A-graph
    again = load_bim(out / IFC, out / "cache").graph
    assert again.wall_surfaces == graph.wall_surfaces and again.rooms == graph.rooms
    assert len(ifcopenshell.open(str(bim)).by_type("IfcWall")) == len(copy.by_type("IfcWall"))


def test_where_there_are_verdicts_every_element_has_its_own(run: tuple[Path, Path], tmp_path: Path) -> None:
    out, bim = run
    for name in ("a_graph.json", "s_graph.json", "deviations.json", "metrics.json", "matches.json", "config.yaml"):
        (tmp_path / name).write_bytes((out / name).read_bytes())
    model = ifcopenshell.open(str(bim))
    door, slab, wall = (model.by_type(kind)[0].GlobalId for kind in ("IfcDoor", "IfcSlab", "IfcWall"))
    surface = SceneGraph.load(out / "a_graph.json").wall_surfaces[0]
    write_elements(tmp_path, [
        verdict(door, "Door", "absent", surface, ifc_class="IfcDoor"), verdict(slab, "Slab", "not seen", surface),
        verdict(wall, "Wall", "moved", surface, 0.05, direction=(0.0, 0.6, 0.8)),
    ], 0.03)  # fmt: skip
    (line, *_) = export(tmp_path, ["ifc"], bim)
    assert "3 elements" in line
    copy = ifcopenshell.open(str(tmp_path / IFC))
    metre = ifcopenshell.util.unit.calculate_unit_scale(copy)
    told = [ifcopenshell.util.element.get_pset(copy.by_guid(name), "AsBuilt") for name in (door, slab, wall)]
    assert [t["Status"] for t in told] == ["absent", "not seen", "moved"]
    assert [t["ShareSeen"] for t in told] == [0.85, 0.0, 0.85] and "LevelOfAccuracy" not in told[0]
    assert (told[2]["LevelOfAccuracy"], told[2]["Conclusive"], told[2]["Views"]) == ("LOA30", True, 7)
    moved = [told[2][f"Offset{axis}"] * metre for axis in "XYZ"]
    np.testing.assert_allclose(moved, [0.0, 0.03, 0.04], atol=1e-9)
    assert ifcopenshell.util.element.get_pset(copy.by_type("IfcWall")[1], "AsBuilt") is None


def test_a_wall_that_the_plan_lacks_stands_in_the_copy(run: tuple[Path, Path]) -> None:
    copy = ifcopenshell.open(str(run[0] / IFC))
    (proxy,) = copy.by_type("IfcBuildingElementProxy")
    assert ifcopenshell.util.element.get_pset(proxy, "AsBuilt", "Status") == "unplanned"
    assert ifcopenshell.util.element.get_container(proxy).Name == STOREY
    metre = ifcopenshell.util.unit.calculate_unit_scale(copy)
    T = ifcopenshell.util.placement.get_local_placement(proxy.ObjectPlacement)
    # from the map: the left end at (-0.5, 2), 0.1 m over the floor, which lies 0.8 m under the first pose
    x, y = np.array([[np.cos(YAW), -np.sin(YAW)], [np.sin(YAW), np.cos(YAW)]]) @ [-0.5, 2.0]
    np.testing.assert_allclose(T[:3, 3] * metre, [3000.0 + x, -2000.0 + y, 41.0 - 0.8 + 0.1], atol=1e-6)
    solid = proxy.Representation.Representations[0].Items[0]
    assert solid.Depth * metre == pytest.approx(2.1)


@pytest.mark.parametrize("version", BCF)
def test_topics_name_the_walls_and_look_at_them(run: tuple[Path, Path], version: Version) -> None:
    reader = pytest.importorskip("bcf.bcfxml", reason="bcf-client is a development extra")
    out, graph = run[0], SceneGraph.load(run[0] / "a_graph.json")
    moved, absent = list(dict.fromkeys(w.source for w in graph.wall_surfaces))[:2]
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
            for guid in found[label]:  # the camera's middle ray meets the wall
                surface = next(w for w in graph.wall_surfaces if w.source == guid)
                away = np.subtract(surface.centroid, place[:2])
                assert away[0] * ahead[1] - away[1] * ahead[0] == pytest.approx(0.0, abs=1e-3) and ahead[2] < 0
    assert found == {"moved": [moved], "absent": [absent], "extra": []}


def test_elements_of_the_topics_are_in_the_order_of_the_schema(run: tuple[Path, Path]) -> None:
    order = ["Title", "Index", "Labels", "CreationDate", "CreationAuthor", "Description"]
    for version, name in BCF.items():
        with zipfile.ZipFile(run[0] / name) as archive:
            parsed = {part: ElementTree.fromstring(archive.read(part)) for part in archive.namelist()}
        markups = [markup for part, markup in parsed.items() if part.endswith("markup.bcf")]
        tags = order if version == "2.1" else [*order, "Viewpoints"]
        assert [[own.tag for own in markup.iterfind("Topic/*")] for markup in markups] == [tags] * 3
        assert {own.text for markup in markups for own in markup.iter("Filename")} == {run[1].name}
        assert ("extensions.xml" in parsed) == (version == "3.0")


def test_a_model_of_another_building_is_refused(run: tuple[Path, Path], tmp_path: Path) -> None:
    for path in run[0].iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / IFC).unlink()
    (tmp_path / "deviations.json").unlink()
    walls = [own for own in json.loads((run[0] / "deviations.json").read_text()) if own["source"]]
    (tmp_path / "deviations.json").write_text(json.dumps([own | {"source": "0" * 22} for own in walls]))
    with pytest.raises(UserError, match="none of the elements"):
        export(tmp_path, ["ifc"], run[1])
    assert not (tmp_path / IFC).exists()


@pytest.mark.skipif(not SHARED_2X3.exists(), reason="the shared data is not there")
def test_models_of_the_older_schema_too(tmp_path: Path) -> None:
    model = ifcopenshell.open(str(SHARED_2X3))
    wall = model.by_type("IfcWall")[0]
    finding = ElementFinding(wall.GlobalId, "moved", (0.1, 0.0, 0.0), 0.01, 0.0, "because")
    assert write_as_built(SHARED_2X3, [finding], [], tmp_path / "copy.ifc") == 1
    copy = ifcopenshell.open(str(tmp_path / "copy.ifc"))
    again = copy.by_guid(wall.GlobalId)
    told = ifcopenshell.util.element.get_pset(again, "AsBuilt")
    assert told["Offset"] * ifcopenshell.util.unit.calculate_unit_scale(copy) == pytest.approx(0.1)
    items = [i for r in again.Representation.Representations if r.RepresentationIdentifier == "Body" for i in r.Items]
    assert items and all(i.StyledByItem[0].Styles[0].Styles[0].Name == "As built: moved" for i in items)
