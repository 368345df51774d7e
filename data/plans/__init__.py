"""Any plan as an A-graph: IFC, drawings, GeoJSON, floor plan data sets; meshes by their own command."""

from data.plans.bim import Bim, load_bim, read_plans
from data.plans.polygons import Plan

__all__ = [
    "Bim",
    "Plan",
    "load_bim",
    "read_plans",
]
