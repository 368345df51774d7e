"""Golden references: the results of one commit, against which those of another are compared."""
