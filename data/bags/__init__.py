"""Messages in bags of ROS 1 and 2, whatever they hold."""

from data.bags.bag import BAG_SUFFIXES, Bag, decoded, is_bag, reason
from data.bags.in_order import Record, mcap_records

__all__ = ["BAG_SUFFIXES", "Bag", "Record", "decoded", "is_bag", "mcap_records", "reason"]
