"""Where a plan lies on the map: what a model says, and points from one to the other."""

from pathlib import Path

import ifcopenshell
import ifcopenshell.guid
import numpy as np
import pytest
from small_ifc import write_small_ifc

from data import SceneGraph
from data.ifc.deviations import write_as_built
from data.ifc.georeference import georeference_of
from data.plans import load_bim
from data.scene_graph import Georeference

YAW = 0.6
ORIGIN = {"Eastings": 400_000.0, "Northings": 5_500_000.0, "OrthogonalHeight": 34.0}


def stated(model: ifcopenshell.file, **scale: float) -> ifcopenshell.file:
    """The model with a map conversion, in metres on the map where it has the attributes for it."""
    axis = {"XAxisAbscissa": float(np.cos(YAW)), "XAxisOrdinate": float(np.sin(YAW))}
    context = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)[0]
    metre = model.create_entity("IfcSIUnit", None, "LENGTHUNIT", None, "METRE")
    crs = model.create_entity("IfcProjectedCRS", Name="EPSG:25832", MapUnit=metre)
    model.create_entity("IfcMapConversion", context, crs, **ORIGIN, **axis, **scale)
    return model


@pytest.mark.parametrize(("millimetres", "scale"), [(False, 0.9996), (True, 0.0009996), (True, 0.9996)])
def test_a_plan_knows_its_place_on_the_map(tmp_path: Path, millimetres: bool, scale: float) -> None:
    """In whichever units, and the scale of the units may be left out; the copy of the model keeps the record."""
    path = write_small_ifc(tmp_path / "small.ifc", site=(3.0, -2.0, 0.0), millimetres=millimetres).path
    model = stated(ifcopenshell.open(str(path)), Scale=scale)
    model.write(str(path))
    graph = load_bim(path, tmp_path).graph
    graph.save(tmp_path / "a_graph.json")
    for known in (graph.georeference, SceneGraph.load(tmp_path / "a_graph.json").georeference):
        assert known is not None and known.crs == "EPSG:25832"
        found = known.easting, known.northing, known.height, known.rotation, known.scale
        np.testing.assert_allclose(found, [*ORIGIN.values(), YAW, 0.9996], rtol=1e-12)
    write_as_built(path, [], [], tmp_path / "copy.ifc")
    (kept,) = ifcopenshell.open(str(tmp_path / "copy.ifc")).by_type("IfcMapConversion")
    assert kept.get_info(recursive=True) == model.by_type("IfcMapConversion")[0].get_info(recursive=True)


def test_models_of_the_older_schema_have_it_in_property_sets() -> None:
    model = ifcopenshell.file(schema="IFC2X3")
    project = model.create_entity("IfcProject", ifcopenshell.guid.new())
    assert georeference_of(model) == (None, [])
    for name, values in (("MapConversion", ORIGIN), ("ProjectedCRS", {"Name": "EPSG:25832"})):
        kinds = {float: "IfcReal", str: "IfcLabel"}
        own = [model.create_entity(kinds[type(value)], value) for value in values.values()]
        each = zip(values, own, strict=True)
        properties = [model.create_entity("IfcPropertySingleValue", key, None, value) for key, value in each]
        ids = ifcopenshell.guid.new(), ifcopenshell.guid.new()
        of_project = model.create_entity("IfcPropertySet", ids[0], None, f"ePSet_{name}", None, properties)
        model.create_entity("IfcRelDefinesByProperties", ids[1], None, None, None, [project], of_project)
    known, notices = georeference_of(model)
    assert known is not None and (known.easting, known.crs, notices) == (400_000.0, "EPSG:25832", [])


def test_what_cannot_be_is_left_out_with_a_notice(tmp_path: Path) -> None:
    model = ifcopenshell.open(str(write_small_ifc(tmp_path / "small.ifc").path))
    known, (notice,) = georeference_of(stated(model, Scale=0.3))
    assert known is None and "scale" in notice


def test_points_and_poses_there_and_back() -> None:
    known = Georeference("EPSG:25832", 4e5, 5.5e6, 30.0, rotation=YAW, scale=0.9996)
    points = np.random.default_rng(0).normal(0.0, 50.0, (20, 3))
    np.testing.assert_allclose(known.in_plan(known.on_map(points)), points, atol=1e-8)
    pose = np.eye(4)
    pose[:3, 3] = 10.0, 0.0, 2.0
    (moved,) = known.poses_on_map(pose[None])
    np.testing.assert_allclose(moved[:3, 3], known.on_map(pose[None, :3, 3])[0])
    np.testing.assert_allclose(moved[:2, 0], [np.cos(YAW), np.sin(YAW)])
