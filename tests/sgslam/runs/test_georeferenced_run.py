"""A run in a plan that knows its place on the map is the run in a plan drawn on the map."""

from pathlib import Path

import ifcopenshell
import numpy as np
import pytest
import trimesh
from commands import called
from drives import fed, small_drive
from small_ifc import write_small_ifc

from data.common.errors import UserError
from data.plans import load_bim
from sgslam.cli.export import export
from sgslam.slam import SceneGraphSlam

SITE, YAW = (400_000.0, 5_500_000.0, 40.0), 0.87


def test_a_site_far_from_zero_with_a_turned_north(tmp_path: Path) -> None:
    scans = small_drive().scans[:120]
    near, far = (tmp_path / f"{name}.ifc" for name in ("near", "far"))
    write_small_ifc(far, site=SITE, yaw=YAW)
    model = ifcopenshell.open(str(write_small_ifc(near).path))
    context, *_ = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)
    crs = model.create_entity("IfcProjectedCRS", Name="EPSG:25832")
    model.create_entity("IfcMapConversion", context, crs, *SITE, float(np.cos(YAW)), float(np.sin(YAW)))
    model.write(str(near))
    of_near, of_far = (fed(SceneGraphSlam(load_bim(path)), scans).finish() for path in (near, far))
    assert of_near.anchored and len(of_near.trajectory) == len(of_far.trajectory)
    known, out = of_near.metrics()["georeference"], tmp_path / "out"
    assert (known["crs"], known["easting"], known["rotation"]) == ("EPSG:25832", SITE[0], pytest.approx(YAW))
    assert of_far.metrics()["georeference"] is None
    of_near.save(out)
    assert "EPSG:25832: origin of the plan at E 400000.000 m" in (out / "report.html").read_text()
    done = called("sgslam.cli.export", "--out", out, "--format", "kitti", "ply", "--georeferenced")
    assert done.returncode == 0, done.stderr
    poses = np.loadtxt(out / "trajectory.kitti").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses, of_far.trajectory.poses[:, :3], rtol=0.0, atol=1e-4)
    assert b"comment EPSG:25832" in (out / "map.ply").read_bytes()[:99]
    points = trimesh.load(out / "map.ply").vertices
    assert (np.abs(points - poses[:, :, 3].mean(axis=0)) < 15.0).all() and len(np.unique(points, axis=0)) == len(points)
    of_far.save(out)
    with pytest.raises(UserError, match="no IfcMapConversion"):
        export(out, ["ply"], georeferenced=True)
