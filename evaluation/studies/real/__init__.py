"""Recordings of real buildings: which data set a folder holds, whether it is whole, and how well runs do on it."""
