"""Anchors what other SLAM systems left behind to a plan."""
