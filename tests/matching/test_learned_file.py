"""The learned network's file: names and shapes are torch's, and what is not one whole network is refused."""

import io
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from data import UserError
from matching import Matcher
from matching.learned.network import CompiledNetwork
from matching.learned.torch_weights import load_network, save_network
from matching.learned.weights_file import MOST_BYTES, load_learned, read_learned, write_learned
from matching.network.dimensions import Settings
from matching.network.network import MatchingNetwork
from matching.network.pca_gm import PcaGm, PcaGmSettings

Arrays = dict[str, NDArray[Any]]
TINY = Settings(width=8, layers=1, candidates=4, cycles=2, rounds=1, state=4)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("network") / "n.npz"
    save_network(path, MatchingNetwork(TINY))
    return path


@pytest.mark.parametrize("settings", [Settings(), TINY, Settings(width=32, layers=2, state=16), Settings(layers=1)])
def test_the_compiled_network_takes_what_torchs_has_and_nothing_else(settings: Settings) -> None:
    state = {k: v.numpy() for k, v in MatchingNetwork(settings).requires_grad_(False).state_dict().items()}
    CompiledNetwork(settings, state)
    for name, value in state.items():
        less = {k: v for k, v in state.items() if k != name}
        for other in (less, {**state, name: value[:-1]}, {**state, name: value[None]}, {**state, name: value * np.nan}):
            with pytest.raises(ValueError, match=name):
                CompiledNetwork(settings, other)
    with pytest.raises(ValueError, match="more of it"):
        CompiledNetwork(settings, {**state, "more of it": np.zeros(3, dtype=np.float32)})


@pytest.mark.parametrize("size", [{"width": 0}, {"width": 6}, {"layers": -1}, {"rounds": 5000}, {"state": 4.0}])
def test_sizes_that_no_network_has_are_refused(size: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="sizes"):
        Settings(**size)


def changed(change: Callable[[Arrays], object]) -> Callable[[bytes], bytes]:
    def written(whole: bytes) -> bytes:
        arrays = dict(np.load(io.BytesIO(whole)))
        change(arrays)
        file = io.BytesIO()
        np.savez(file, allow_pickle=True, **arrays)
        return file.getvalue()

    return written


def first(value: Callable[[NDArray[Any]], Any]) -> Callable[[bytes], bytes]:
    """Its first weight is another."""
    name = "weight/encoder.node.0.weight"
    return changed(lambda arrays: arrays.update({name: np.asarray(value(arrays[name]))}))


def turned(whole: bytes) -> bytes:
    """A bit in the midst of the weights."""
    at = len(whole) // 2
    return whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]


def packed(entries: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return file.getvalue()


def header(shape: str, descr: str = "'<f2'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


class Opens:
    """Pickled, it writes a file when it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return open, (str(self._path), "w")


FOREIGN: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda whole: b"",
    "text": lambda whole: b"not a network",
    "cut": lambda whole: whole[: len(whole) // 2],
    "a bit": turned,
    "an array": lambda whole: header("(2,)") + bytes(4),
    "another archive": lambda whole: packed({"readme.txt": b"hello"}),
    "an archive of nothing": lambda whole: packed({}),
    "no array": lambda whole: packed({"tag.npy": b"hello"}),
    "claims": lambda whole: packed({"tag.npy": header("(1099511627776,)")}),
    "packed": lambda whole: packed({"tag.npy": header("(9,)") + bytes(MOST_BYTES)}),
    "no tag": changed(lambda a: a.pop("tag")),
    "two tags": changed(lambda a: a.update(tag=np.array([a["tag"]] * 2))),
    "another version": changed(lambda a: a.update(tag=np.array("sgslam learned 3"))),
    "no weights": changed(lambda a: [a.pop(k) for k in list(a) if k.startswith("weight/")]),
    "no settings": changed(lambda a: [a.pop(k) for k in list(a) if k.startswith("setting/")]),
    "another setting": changed(lambda a: a.update({"setting/depth": np.array(3)})),
    "other sizes": changed(lambda a: a.update({"setting/state": np.array(8)})),
    "wild sizes": changed(lambda a: a.update({"setting/rounds": np.array(1 << 40)})),
    "half a size": changed(lambda a: a.update({"setting/rounds": np.array(1.5)})),
    "sizes": changed(lambda a: a.update({"setting/rounds": np.array([1, 2])})),
    "more": changed(lambda a: a.update(more=np.zeros(2))),
    "another shape": first(lambda x: x.T),
    "another kind of number": first(lambda x: x.astype(np.float64)),
    "infinite": first(lambda x: x * np.float16(np.inf)),
    "objects": first(lambda x: np.array([{}], dtype=object)),
}


@pytest.mark.parametrize("what", FOREIGN)
def test_what_is_not_one_whole_network_is_refused(path: Path, tmp_path: Path, what: str) -> None:
    (tmp_path / "n.npz").write_bytes(FOREIGN[what](path.read_bytes()))
    with pytest.raises(UserError, match=r"n\.npz: .*(train it again|not a network's file)") as told:
        Matcher.load(f"learned@{tmp_path / 'n.npz'}")
    assert "\n" not in str(told.value)


def test_every_cut_is_noticed(path: Path, tmp_path: Path) -> None:
    whole, cut = path.read_bytes(), tmp_path / "n.npz"
    for length in range(0, len(whole), 997):
        cut.write_bytes(whole[:length])
        with pytest.raises(UserError):
            load_learned(cut)


def test_nothing_of_a_file_is_run(tmp_path: Path) -> None:
    (tmp_path / "n.npz").write_bytes(pickle.dumps(Opens(tmp_path / "ran")))
    with pytest.raises(UserError, match="not a network's file"):
        load_learned(tmp_path / "n.npz")
    (tmp_path / "n.npz").write_bytes(packed({"tag.npy": header("()", "'|O'") + pickle.dumps(Opens(tmp_path / "ran"))}))
    with pytest.raises(UserError, match="not a network's file"):
        load_learned(tmp_path / "n.npz")
    assert not (tmp_path / "ran").exists()


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "folder.npz").mkdir()
    for name in ("folder.npz", "missing.npz"):
        with pytest.raises(UserError, match=rf"{name}: cannot be read \(.+\)"):
            load_learned(tmp_path / name)


def test_the_form_is_exact_and_only_the_learned_networks(path: Path, tmp_path: Path) -> None:
    settings, state = read_learned(path)
    write_learned(tmp_path / "again.npz", settings, state)
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()
    with pytest.raises(UserError, match="does not fit"):
        load_network(path, "pca-gm")
    with pytest.raises(ValueError, match="only the learned network has this format"):
        save_network(tmp_path / "relative.npz", PcaGm(PcaGmSettings()))
