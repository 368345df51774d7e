"""`Matcher`: finds where an S-graph lies in an A-graph, by one of several methods."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Union

from data.common.errors import UserError
from data.scene_graph import SceneGraph, implausible
from matching.published.combinatorial import CombinatorialMatcher
from matching.result import AnyMatcher, MatchResult, Start

if TYPE_CHECKING:
    from matching.engine import GeometricMatcher
    from matching.published.matcher import PaperMatcher

Method = Union[CombinatorialMatcher, "GeometricMatcher", "PaperMatcher"]
DEFAULT = "voting"  # the method of runs, and of commands that are given none
WITH_WEIGHTS = ("learned", "paper")


class Matcher:
    """Finds where an S-graph is in an A-graph. Create one with `Matcher.load(method)`."""

    def __init__(self, method: Method) -> None:
        self._method = method

    @staticmethod
    def load(method: str = DEFAULT) -> "Matcher":
        """Loads a matching method by name.

        Args:
            method: One of
                `voting`: wall corners vote for places, and the evidence of all walls and doors decides between them;
                `learned`: the same places, but a network judges how probable each is;
                `paper`: the published GATv2-Sinkhorn matcher; its assignment is the answer, without verification;
                `combinatorial`: the search of iS-Graphs, which ends after 60 s at most.
                `NAME@WEIGHTS` loads other weights than those that come with the package: a file, for example
                `learned@my_judge/judge.safetensors`; for `paper` also `published` (the default) or `repository`.

        Returns:
            A matcher. It may be used for any number of graphs; what it computes for the last few plans is cached.

        Raises:
            UserError: The name is unknown, the method takes no weights, the file has no weights that fit, or PyTorch,
                which `paper` needs, is not installed.
        """
        name, _, weights = method.partition("@")
        methods: dict[str, Callable[[], Method]] = {
            "voting": _voting,
            "learned": lambda: _learned(weights or None),
            "paper": lambda: _paper(weights or "published"),
            "combinatorial": CombinatorialMatcher,
        }
        if name not in methods:
            raise UserError(f"no matching method '{name}'; there are: {', '.join(methods)}")
        if weights and name not in WITH_WEIGHTS:
            raise UserError(f"the matching method '{name}' takes no weights; {', '.join(WITH_WEIGHTS)} do")
        return Matcher(methods[name]())

    def without_judge(self) -> "Matcher":
        """The same method, decided by the evidence alone."""
        from matching.engine import GeometricMatcher

        return Matcher(GeometricMatcher()) if isinstance(self._method, GeometricMatcher) else self

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """Finds the place of an S-graph in an A-graph.

        Args:
            s: The S-graph of one storey, in the map frame (metres, z up).
            a: The A-graph of any number of storeys, in the BIM frame (metres).
            floor: The id of the only A floor to search; None searches all.
            start: A rough pose (yaw, x, y) of the map's origin in the BIM frame, in radians and metres, in the order
                of `T_a_s`. Placements more than 3 m or 60 degrees away from it are dropped.

        Returns:
            The match. `T_a_s` is (yaw, x, y) in radians and metres: p_a = R(yaw) p_s + (x, y). Rely on it only if the
            status is `unique`. `learned` and `voting` do not search for mirror images, but a mirrored map of many rooms
            may get a unique answer: if the map may be mirrored, match `data.scene_graph.graph.mirrored(s)` too, as
            runs do, and rely on the answer only if that one explains less. Graphs without wall surfaces, and graphs
            that cannot be in metres or whose normals point out of their rooms (see `data.scene_graph.implausible`), do
            not raise: they give the status `none` and the reason.
        """
        for what, graph in (("S-graph", s), ("A-graph", a)):
            if (wrong := implausible(graph)) is not None:
                return MatchResult("none", f"{what}: {wrong}")
        return self._method.match(s, a, floor=floor, start=start)


def _voting() -> Method:
    from matching.engine import GeometricMatcher  # compiled loops are slow to import

    return GeometricMatcher()


def _learned(weights: str | None) -> Method:
    from matching.engine import GeometricMatcher
    from matching.judge import Judge

    return GeometricMatcher(Judge.load(weights))


def _paper(weights: str) -> Method:
    try:
        from matching.published.matcher import PaperMatcher, load_paper_network
    except ModuleNotFoundError as error:
        raise UserError(f"the matching method 'paper' needs {error.name}; pip install 'sgslam[torch]'") from None
    return PaperMatcher(load_paper_network(weights))


def make_ready(matcher: AnyMatcher) -> None:
    """Matches a small plan with itself, so that compiled loops are loaded or compiled before a robot needs them."""
    from data.generation.buildings import generate_plan

    plan = generate_plan("apartment", 0).graph
    matcher.match(plan, plan)
