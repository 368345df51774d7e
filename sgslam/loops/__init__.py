"""Loop closure: candidates, search, registration, and the closures that hold."""
