"""Any plan (IFC, drawing, GeoJSON, mesh, floor plan data set) as an A-graph."""
