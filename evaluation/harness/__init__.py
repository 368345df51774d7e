"""The instrument: a study is a function from a case to a record; its rows are kept, and pages are made from them."""

from evaluation.harness.study import STUDIES, Case, Claim, Cost, Options, Record, Study, load_study

__all__ = ["STUDIES", "Case", "Claim", "Cost", "Options", "Record", "Study", "load_study"]
