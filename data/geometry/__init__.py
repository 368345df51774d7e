"""Poses, SE(2) motions, polygons, intervals and ray casting: plain numpy and shapely, no files."""
