"""Any plan as an A-graph: IFC, drawings, GeoJSON, floor plan data sets; meshes by their own command."""

from data.plans.bim import Bim, load_bim
from data.plans.polygons import Plan
from data.plans.sources import read_plans

__all__ = [
    "Bim",
    "Plan",
    "load_bim",
    "read_plans",
]
