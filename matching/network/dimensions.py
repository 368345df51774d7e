"""What the network and its compiled form have in common beside the weights: sizes and bounds."""

from dataclasses import dataclass

LARGEST = 4096  # no width, number of layers, ... of a network is larger
HEADS = 4  # of the encoder's attention


@dataclass(frozen=True)
class Settings:
    """The size of a network; kept in its file."""

    width: int = 32
    layers: int = 2
    candidates: int = 8  # by their vectors
    more: int = 4  # in each later cycle, by where the neighbours are
    cycles: int = 2
    rounds: int = 2  # of each cycle
    state: int = 16

    def __post_init__(self) -> None:
        """Raises ValueError for sizes that no network has."""
        sizes = vars(self).values()
        if not all(type(size) is int and 0 < size <= LARGEST for size in sizes) or self.width % HEADS:
            raise ValueError(f"a network cannot be of such sizes: {self}")


NOTHING = -1e4  # a logit that is as good as minus infinity
SHARE_SIZE = 6  # of what is told of an S room and an A room
ROOM_WIDTH = 24  # of the step that makes log odds of it
LEAST_ODDS = -12.0  # log odds of rooms that have a say on walls
ROOM_UNKNOWN = -3.0  # log odds of the rooms where one of two walls has none

# Candidates: the few A walls that each S wall might be.
VOTES_EACH = 2  # partners of a neighbour that tell where a wall may be
LEAST_LIKELY = 0.05  # of a partner that tells
TRUST = 0.5  # most that such a candidate starts with
CLOSE_M = 0.5

# Two pairs of walls, one of each graph, compared.
SUPPORTERS = 10  # neighbours of a wall that have a say
OFFSET_M = 2.5  # pairs whose distance differs by more are not looked at,
LEFT_M = 1.2  # nor those whose offsets differ by more where walls may slide
LEAST_COS = 0.9  # of the angle by which two pairs differ
SCALES_M = (0.12, 0.35, 1.0)
COMPATIBLE_WIDTHS, REASONS = (32, 24), 12  # of the steps that make reasons of it, and how many these are
COMPARED_SIZE = 4 * len(SCALES_M) + 2 * len(SCALES_M) + 9

# How much of the map agrees with a candidate.
AGREEMENTS = 3  # within the sharp reach, within the wide one, and the latter beside the best candidate's
REACHES = ((0.5, 0.03), (1.5, 0.1))  # metres, and metres for each metre of distance
VOTERS = 64  # candidates that are asked: the likeliest, the largest
LEAST_VOTER_COS = 0.97  # of the angle between two motions that may agree
PAIR_SIZE = 7 + AGREEMENTS  # of what is known of a candidate by itself
