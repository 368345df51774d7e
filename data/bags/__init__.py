"""Messages in bags of ROS 1 and 2, whatever they hold."""

from data.bags.bag import BAG_SUFFIXES, Bag, is_bag
from data.bags.recovery import Record

__all__ = ["BAG_SUFFIXES", "Bag", "Record", "is_bag"]
