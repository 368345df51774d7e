"""The building in which all simulations take place: far from zero, turned, in millimetres."""

import pytest
from small_ifc import SmallBuilding, write_small_ifc


@pytest.fixture(scope="session")
def building(tmp_path_factory: pytest.TempPathFactory) -> SmallBuilding:
    path = tmp_path_factory.mktemp("ifc") / "small.ifc"
    return write_small_ifc(path, site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0, millimetres=True)
