"""Data sets: which one a folder holds, what of it is missing or not whole, and how a recording is opened."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest

from data.common.errors import UserError
from data.datasets import data_set_in

POSES = b"".join(b"%d %d 0 0 0 0 0 1\n" % (t, t) for t in (1, 2))
IFC = b"ISO-10303-21;\nEND-ISO-10303-21;\n"
PCD = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 9\nHEIGHT 1\nPOINTS 9\nDATA binary\n"
LIST = b"- {name: hall, bim: plan.ifc, scans: scans, truth: truth.tum, storey: Ground}\n"
SESSION = "sensor_data/3F_Region1/points/"


def npy() -> bytes:
    file = io.BytesIO()
    np.save(file, np.ones((30, 3)))
    return file.getvalue()


def bag(index: int) -> bytes:
    return b"#ROSBAG V2.0\n" + struct.pack("<II", 69, 18) + b"index_pos=" + struct.pack("<Q", index)


FORMS: dict[str, dict[str, bytes]] = {
    "SLABIM": {
        **{f"BIM/3F/mesh/{part}.ply": b"ply" for part in ("walls", "floors")},
        **{f"{SESSION}data/{number}.npy": npy() for number in range(2)},
        **{f"{SESSION}timestamps.txt": b"1\n2\n", f"{SESSION}pose_frame_to_bim.txt": POSES},
    },
    "ConSLAM": {"model.ifc": IFC, "sequence_2/1.npy": npy(), "sequence_2.txt": POSES, "sequence_10.bag": bag(1)},
    "Hilti 2021": {"a/Base_4.bag": bag(1), "Base_4_prism.txt": POSES, "calibration.yaml": b"{sensors: {os_lidar: 1}}"},
    "own recordings": {"sequences.yaml": LIST, "plan.ifc": IFC, "scans/0.npy": npy(), "truth.tum": POSES},
}
RECORDINGS = [("SLABIM", "3F_Region1"), ("ConSLAM", "sequence_2"), ("Hilti 2021", "Base_4"), ("own recordings", "hall")]


def written(folder: Path, name: str, **changed: bytes | None) -> Path:
    """A data set's folder; files that begin as a changed one have its content, or are missing for None."""
    for path, content in (FORMS[name] | {path: own for path, own in changed.items() if own is not None}).items():
        if not any(own is None and path.startswith(begin) for begin, own in changed.items()):
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
    return folder


@pytest.mark.parametrize(("name", "sequence"), RECORDINGS)
def test_a_data_set_is_recognised_by_its_files(tmp_path: Path, name: str, sequence: str) -> None:
    found = data_set_in(written(tmp_path, name))
    assert (found.name, found.sequences()) == (name, [sequence])
    assert found.building(sequence) == ("plan.ifc" if name == "own recordings" else name)
    if name != "Hilti 2021":
        found.check(sequence)
    if name in ("ConSLAM", "own recordings"):
        recording = found.open(sequence, tmp_path)
        assert len(recording.scans) == 1 and recording.truth.positions[:, 0].tolist() == [1, 2]
        assert recording.plan is not None and recording.plan.suffix == ".ifc"
        assert recording.storey == ("Ground" if name == "own recordings" else None)


@pytest.mark.parametrize(
    ("name", "path", "content", "message"),
    [
        ("SLABIM", "BIM/3F/mesh/walls.ply", None, "walls.ply: is missing; unpack BIM.zip again"),
        ("SLABIM", f"{SESSION}data/2.pcd", PCD, r"2\.pcd: cut off: its header claims 108 bytes"),
        ("SLABIM", f"{SESSION}timestamps.txt", b"1\n", "1 stamps for 2 scans"),
        ("SLABIM", SESSION, None, r"no session .* download 3F_Region1.zip or another"),
        ("ConSLAM", "model.ifc", None, "0 IFC files in it; put the one of 'ConSLAM BIM and GT Poses'"),
        ("ConSLAM", "model.ifc", IFC[:-9], "model.ifc: is cut off"),
        ("Hilti 2021", "a/", None, r"no bag with a truth in it; download Base_4\.bag"),
        ("Hilti 2021", "a/Base_4.bag", bag(10**6), r"Base_4\.bag: is cut off: \d+ of more than 1000000 bytes"),
        ("Hilti 2021", "calibration.yaml", None, "no calibration.yaml"),
        ("Hilti 2021", "floor_1/2025-05-05/run_1/a.bag", b"", "2026 cannot be run: .* no LiDAR scans"),
        ("own recordings", "plan.ifc", None, "plan.ifc: is missing; correct the paths of 'hall'"),
        ("own recordings", "scans/0.npy", npy()[:-9], r"scans: 0\.npy: "),
        ("own recordings", "sequences.yaml", b"[", "cannot read this file"),
        ("own recordings", "sequences.yaml", 2 * LIST, "each with a name of its own"),
        ("own recordings", "sequences.yaml", b"- {name: hall, bim: a}", "0.scans: Field required"),
    ],
)
def test_what_is_missing_or_not_whole_is_said(
    tmp_path: Path, name: str, path: str, content: bytes | None, message: str
) -> None:
    found = data_set_in(written(tmp_path, name, **{path: content}))
    with pytest.raises(UserError, match=message):
        found.check(found.sequences()[0])
