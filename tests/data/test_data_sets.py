"""Data sets: which one a folder holds, what of it is missing or not whole, and how a recording is opened."""

import io
from pathlib import Path

import numpy as np
import pytest

from data.common.errors import UserError
from data.datasets import data_set_in

POSES = b"".join(b"%d %d 0 0 0 0 0 1\n" % (t, t) for t in (1, 2))
IFC = b"ISO-10303-21;\nEND-ISO-10303-21;\n"
LIST = b"- {name: hall, bim: plan.ifc, scans: scans, truth: truth.tum, storey: Ground}\n"
SESSION = "sensor_data/3F_Region1/points/"


def npy() -> bytes:
    file = io.BytesIO()
    np.save(file, np.ones((30, 3)))
    return file.getvalue()


FORMS: dict[str, dict[str, bytes]] = {
    "SLABIM": {
        "sensor_data/README": b"",
        **{f"BIM/3F/mesh/{part}.ply": b"ply" for part in ("walls", "floors")},
        **{f"{SESSION}data/{number}.npy": npy() for number in range(2)},
        **{f"{SESSION}timestamps.txt": b"1\n2\n", f"{SESSION}pose_frame_to_bim.txt": POSES},
    },
    "ConSLAM": {"model.ifc": IFC, "sequence_2/1.npy": npy(), "sequence_2.txt": POSES, "sequence_10.bag": b"bag"},
    "own recordings": {"sequences.yaml": LIST, "plan.ifc": IFC, "scans/0.npy": npy(), "truth.tum": POSES},
}
RECORDINGS = [("SLABIM", "3F_Region1"), ("ConSLAM", "sequence_2"), ("own recordings", "hall")]


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
    assert (found.name, list(found.entries)) == (name, [sequence])
    assert found.building(sequence) == ("plan.ifc" if name == "own recordings" else name)
    found.check(sequence)
    if name in ("ConSLAM", "own recordings"):
        recording = found.open(sequence, tmp_path)
        assert len(recording.scans) == 1 and recording.truth.positions[:, 0].tolist() == [1, 2]
        assert recording.plan.suffix == ".ifc"
        assert recording.storey == ("Ground" if name == "own recordings" else None)


@pytest.mark.parametrize(
    ("name", "path", "content", "message"),
    [
        ("SLABIM", "BIM/3F/mesh/walls.ply", None, "walls.ply: is missing or empty; unpack BIM.zip"),
        ("SLABIM", f"{SESSION}data", None, "points.data: does not exist"),
        ("SLABIM", f"{SESSION}timestamps.txt", b"1\n", "1 stamps for 2 scans"),
        ("SLABIM", f"{SESSION}timestamps.txt", b"1\nlate\n", "timestamps.txt, line 2"),
        ("SLABIM", "sensor_data/3F", None, "no recordings, .* unpack .* such as 3F_Region1.zip"),
        ("ConSLAM", "model.ifc", None, "model.ifc: is missing .* 'ConSLAM BIM and GT Poses'"),
        ("own recordings", "plan.ifc", b"", "plan.ifc: is missing or empty; correct the paths"),
        ("own recordings", "sequences.yaml", b"[", "cannot read this file"),
        ("own recordings", "sequences.yaml", 2 * LIST, "each with a name of its own"),
        ("own recordings", "sequences.yaml", b"- {name: hall, bim: a}", "0.scans: Field required"),
    ],
)
def test_what_is_missing_or_not_whole_is_said(
    tmp_path: Path, name: str, path: str, content: bytes | None, message: str
) -> None:
    with pytest.raises(UserError, match=message):
        found = data_set_in(written(tmp_path, name, **{path: content}))
        found.check(next(iter(found.entries)))
