"""Files of IMU samples: bags, and EuRoC's form, `timestamp [ns], w_x, w_y, w_z [rad/s], a_x, a_y, a_z [m/s2]` a line.

Source: the EuRoC MAV dataset (Burri et al., IJRR 2016), `imu0/data.csv`.
"""

from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.common.files import write_atomically
from data.imu.samples import ImuSamples, checked_imu

_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_FORM = "'timestamp [ns], w_x, w_y, w_z, a_x, a_y, a_z'"


def read_imu(path: Path | str, topic: str | None = None) -> ImuSamples:
    """Reads IMU samples from a bag (of several IMUs, the one of `topic`) or from a CSV file in EuRoC's format, in which
    comments (#) and blank lines are skipped.

    Raises UserError, with the line number if there is one, for a file that cannot be read or contains something else,
    for a `topic` of a file that is not a bag, and as `read_imu_bag` and `checked_imu` do.
    """
    from data.bags import is_bag
    from data.imu.bags import read_imu_bag

    if is_bag(Path(path)):
        return read_imu_bag(path, topic)
    if topic is not None:
        raise UserError(f"--imu-topic {topic}: {path} is not a bag and has no topics")
    try:
        lines = Path(path).read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        raise UserError(f"{path}: cannot be read; give a bag, or lines of {_FORM}") from None
    stamps: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        fields = line.partition("#")[0].split(",")
        if fields == [""] or fields[0].strip() == "timestamp":
            continue
        try:
            stamp, values = int(fields[0]), [float(field) for field in fields[1:]]
        except ValueError:
            raise UserError(f"{path}, line {number}: not in the form {_FORM}, whole nanoseconds first") from None
        if len(values) != 6 or not -(2**63) <= stamp < 2**63:
            raise UserError(f"{path}, line {number}: not in the form {_FORM}, whole nanoseconds first")
        stamps.append(stamp)
        rows.append(values)
    if not rows:
        raise UserError(f"{path}: no samples in it; give lines of {_FORM}")
    values_of = np.array(rows)
    return checked_imu(np.array(stamps, np.int64), values_of[:, :3], values_of[:, 3:], str(path))


def write_imu(samples: ImuSamples, path: Path | str) -> None:
    """Writes the samples in EuRoC's form, atomically."""
    rows = np.column_stack([samples.gyro, samples.accel]).tolist()
    lines = [
        ",".join([str(stamp), *(f"{value:.12g}" for value in row)])
        for stamp, row in zip(samples.stamps_ns.tolist(), rows, strict=True)
    ]
    write_atomically(path, "\n".join([_HEADER, *lines]) + "\n")
