"""One question each, one command each."""
