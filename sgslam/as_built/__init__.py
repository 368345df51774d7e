"""As built against as planned: deviations, missing and extra walls."""
