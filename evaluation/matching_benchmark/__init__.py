"""The benchmark of the matchers."""
