"""Any plan (IFC, drawing, GeoJSON, mesh, floor plan data set) as an A-graph."""

from data.plans.bim import Bim, load_bim
from data.plans.polygons import Plan
from data.plans.sources import read_plans

__all__ = [
    "Bim",
    "Plan",
    "load_bim",
    "read_plans",
]
