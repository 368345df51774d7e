"""Measurements of the whole system: how long a run takes against KISS-ICP's own pipeline."""
