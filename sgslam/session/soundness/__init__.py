"""How well the poses of a run are known, and the signals that tell sound maps from lost ones."""
