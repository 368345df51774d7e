"""The single measurements, one question and one command each."""
