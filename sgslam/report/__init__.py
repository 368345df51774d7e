"""The report and the plan picture of a run."""
