"""What is known of any LiDAR, of what carries it, and of any building: physics that is measured, not tuned."""

from math import radians
from typing import NamedTuple


class SensorModel(NamedTuple):
    """A LiDAR, and the poses that its points are seen from."""

    range_noise: float = 0.02  # m, standard deviation of a range (data sheets); the texture of walls is within it
    furthest: float = 12.0  # m, beyond which half a degree of heading moves a point by a decimetre
    least_cosine: float = 0.3  # of the angle of incidence; at grazing rays a range says little of the surface's place
    shared_noise: float = 0.0025  # m, standard deviation of what all points of a patch share: walls are no truer
    normal_noise: float = radians(4.0)  # of a surfel's normal, with what surfels of one wall have in common
    apart: float = 0.15  # m off a surface: what lies farther off is another thing
    edge: float = 0.05  # m, how exactly the edge of a body is seen: rays within it of an edge tell nothing
    scan_seconds: float = 0.1  # how long most sensors take for a scan
    longest_scan: float = 2.0  # s; sensors in motion take 0.05 to 0.2


class CarrierModel(NamedTuple):
    """A person, a robot or a cart that carries the sensor indoors."""

    eye: float = 1.2  # m above the floor, at which things are looked at
    bob: float = 0.03  # m, standard deviation of a walking person's up and down
    sweep: float = 0.025  # m, standard deviation of the sensor's place within a scan at walking pace
    climb_drift: float = 0.15  # of the climbed height, twice the standard deviation of what a climb drifts
    moving: float = 0.3  # m/s and rad/s; slower, a scan looks alike whether or not its points are of one instant
    lying: float = radians(45.0)  # off the expected vertical, farther than on most carriers


class BuildingModel(NamedTuple):
    """A building of rooms, as built by masons (DIN 18202) and as lived in."""

    plumb: float = 0.004  # rad, standard deviation of a wall from the vertical: 2 mm/m, and what the attitude errs
    steepest_wall: float = 0.09  # rad between a wall and the vertical
    level: float = 0.005  # rad, standard deviation of a floor's slope: 5 mm/m
    steepest_floor: float = 0.03  # rad, of a surface that counts as level, with what the attitude errs
    parallel_floors: float = 0.003  # rad between two floors or ceilings
    least_floor: float = 0.75  # m2; a tread of a stair has 0.3
    ceiling_reach: float = 3.0  # m between two places of one ceiling: the height may differ from room to room
    storey: float = 4.0  # m: what is seen within one storey rarely spans more
    raised: float = 0.6  # m, by which a floor is left: more than a raised floor and a hand's sway
    uneven: float = 0.2  # m, change of the height of a sensor that is carried over level ground
    landing: float = 2.0  # m of level way; a landing of a stair is shorter
    displaced: float = 0.4  # m, largest offset of an element from its plan; beyond it stands another thing
    around: float = 0.5  # m around an element, in which the faces of what it stands in, or bounds, lie
    parallel: float = 0.99  # cosine between the normals of faces of one body, as they are planned
    one_wall: float = 0.1  # rad between pieces of one wall, as they are mapped
    thinnest_wall: float = 0.03  # m
    thin_wall: float = 0.25  # m, from face to face; low things that are thicker are furniture
    thickest_wall: float = 0.45  # m
    shortest_wall: float = 0.75  # m
    long_wall: float = 1.5  # m, of one whose upper part was not in view
    door_depth: float = 0.4  # m, of the wall that a door stands in
    widest_door: float = 1.2  # m
    longest_leaf: float = 1.3  # m, of a door
    tallest_leaf: float = 2.4  # m
    hinge: float = 1.0  # m, from the middle of a door's opening
    glass: float = 0.3  # share of glass in walls whose windows are not known
    screen: float = 1.3  # m above the floor; what is lower is no wall, and what begins above it hangs
    cupboard: float = 2.0  # m, height; walls are higher
    cupboard_depth: float = 0.8  # m
    least_thing: float = 0.3  # m, extent of a thing that is listed


SENSOR, CARRIER, BUILDING = SensorModel(), CarrierModel(), BuildingModel()
