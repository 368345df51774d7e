"""Sizes and bounds shared by the network and its compiled form."""

from dataclasses import dataclass

LARGEST = 4096  # no width, number of layers, ... of a network is larger
HEADS = 4  # of the encoder's attention


@dataclass(frozen=True)
class Settings:
    """The size of a network, stored in its file."""

    width: int = 32
    layers: int = 2
    candidates: int = 8  # by their vectors
    more: int = 4  # in each later cycle, by where the neighbours are
    cycles: int = 2
    rounds: int = 2  # of each cycle
    state: int = 16

    def __post_init__(self) -> None:
        """Raises ValueError for sizes out of range."""
        sizes = vars(self).values()
        if not all(type(size) is int and 0 < size <= LARGEST for size in sizes) or self.width % HEADS:
            raise ValueError(f"a network cannot be of such sizes: {self}")


NOTHING = -1e4  # a logit that stands for minus infinity
SHARE_SIZE = 6  # of the features of an S room and an A room
ROOM_WIDTH = 24  # of the layer that maps them to log odds
LEAST_ODDS = -12.0  # log odds of rooms, at least, in those of walls
ROOM_UNKNOWN = -3.0  # log odds used if one of two walls has no room

# Candidates: the few A walls that each S wall might be.
VOTES_EACH = 2  # candidates of a neighbour that vote for where a wall may be
LEAST_LIKELY = 0.05  # probability of a candidate that votes
TRUST = 0.5  # most that such a candidate starts with
CLOSE_M = 0.5

# Two pairs of walls, one of each graph, compared.
SUPPORTERS = 10  # neighbours of a wall that send messages
OFFSET_M = 2.5  # pairs whose distance differs by more are ignored,
LEFT_M = 1.2  # nor those whose offsets differ by more where walls may slide
LEAST_COS = 0.9  # of the angle by which two pairs differ
SCALES_M = (0.12, 0.35, 1.0)
COMPATIBLE_WIDTHS, REASONS = (32, 24), 12  # of the layers that map it to weights, and the number of these
COMPARED_SIZE = 4 * len(SCALES_M) + 2 * len(SCALES_M) + 9

# How much of the map agrees with a candidate.
AGREEMENTS = 3  # within the sharp reach, within the wide one, and the latter beside the best candidate's
REACHES = ((0.5, 0.03), (1.5, 0.1))  # metres, and metres for each metre of distance
VOTERS = 64  # candidates that vote: the likeliest, the largest
LEAST_VOTER_COS = 0.97  # of the angle between two motions that may agree
PAIR_SIZE = 7 + AGREEMENTS  # of a candidate's own features
