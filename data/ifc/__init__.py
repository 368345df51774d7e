"""IFC models: read as an A-graph, written, and annotated with what was found on site."""
