"""The methods that are compared: those of `Matcher`, and two that serve the comparison.

`oracle` is `voting` that knows the storey, and the place to within 3 m: what it misses is lost in the noise of the
walls, not in the search.
"""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from data.common.files import read_json
from evaluation.matching.pairs import NEGATIVE, PERTURBED, PUBLISHED, PUBLISHED_MAP, SGSLAM, KnownMap
from matching import Matcher, MatchResult
from matching.matcher import make_ready

ORACLE = "oracle"
COMBINATORIAL = "combinatorial"
PAPER = ("paper@published", "paper@repository")
ALL = ("learned", "voting", ORACLE, *PAPER, COMBINATORIAL)


def applies(method: str, regime: str) -> bool:
    """Whether a method gets such maps: published ones need the start, and iS-Graphs' search takes up to a minute."""
    if method == COMBINATORIAL:
        return regime in (PERTURBED, PUBLISHED_MAP)
    if method == ORACLE:
        return regime not in (NEGATIVE, *PUBLISHED)
    return method not in PAPER or regime in (*PUBLISHED, SGSLAM)


@lru_cache(maxsize=8)
def matcher_named(name: str) -> Matcher:
    """The matcher of this name. Raises UserError for an unknown one."""
    return Matcher.load("voting" if name == ORACLE else name)


@lru_cache(maxsize=8)
def method_named(name: str) -> Callable[[KnownMap], MatchResult]:
    """The method of this name, after a first small match, in which a new installation compiles it.

    Raises UserError for an unknown one.
    """
    matcher = matcher_named(name)
    make_ready(matcher)

    def match(known: KnownMap) -> MatchResult:
        if name != ORACLE:
            return matcher.match(known.drawn.s_graph, known.a_graph)
        floor, start = known.drawn.floor, known.drawn.T_a_s
        return matcher.match(known.drawn.s_graph, known.a_graph, floor=floor, start=start)

    return match


def trained_on(name: str) -> set[str]:
    """The sets of plans that the network in the file of `NAME@FILE` was trained on, by the card beside it."""
    file = Path(name.partition("@")[2])
    cards = (file.with_suffix(".json"), file.with_name("model_card.json")) if file.is_file() else ()
    found = [read_json(card, "the model card of a network") for card in cards if card.is_file()]
    files = [each for card in found[:1] for each in card.get("data", {}).get("files", ())]
    return {Path(each).name.partition(".")[0] for each in files}
