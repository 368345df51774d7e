"""One run, of whose folder most tests look at a part."""

from shared_runs import anchored_run as anchored_run
