"""The matcher that the settings name."""

from matching import Matcher
from matching.protocol import AnyMatcher
from sgslam.config import Config


def default_matcher(config: Config) -> AnyMatcher:
    """Loads `config.matching.method`."""
    return Matcher.load(config.matching.method)
