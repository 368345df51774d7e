"""What several test files share."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
WORKERS = 4  # at most; each takes up to 1.5 GB
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # on small arrays more threads only wait for each other
    os.environ.setdefault(_name, "1")
# a shell that runs the tests in the background has all of their children ignore interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option of `tests/data/fuzzing`; `--hypothesis-seed N` makes other files."""
    parser.addoption("--fuzz", type=int, default=700, metavar="N", help="damaged files for all readers together")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Folders of tests are shared out over the cores, file by file, where pytest-xdist is there and nothing else is
    told (`-n 0` for one process)."""
    from data.common.processes import cores

    option = config.option
    if hasattr(config, "workerinput") or not config.pluginmanager.hasplugin("xdist") or cores() == 1:
        return
    given = option.numprocesses is not None or option.dist != "no" or option.tx or option.usepdb or option.collectonly
    given = given or bool(getattr(option, "cov_source", None))  # pytest-cov has looked for workers already
    if given or not all(Path(word).is_dir() for word in config.args):
        return
    option.numprocesses, option.dist, option.loadscopereorder = min(cores(), WORKERS), "loadfile", False
    from sgslam.warm_up import compile_ahead

    compile_ahead().wait()  # on two cores at once: the workers load it, and do not compile it twice


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that no worker begins one when the others are done."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """IFC files are read once for all tests, by today's code: what the user's cache holds plays no part."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # that of all workers
    (folder / "plans").mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SGSLAM_CACHE_DIR", str(folder / "plans"))
        yield


@pytest.fixture(scope="session")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a Dask scheduler with two workers of one thread, which are started again when they die."""
    from distributed import Client  # slow to import

    folder = tmp_path_factory.mktemp("cluster")
    told = folder / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": f"{HERE.parent}{os.pathsep}{HERE / 'helpers'}", "OMP_NUM_THREADS": "1"}
    dask, log = [sys.executable, "-m", "dask"], (folder / "log").open("wb")
    lines = [
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(told)],
        [*dask, "worker", "--scheduler-file", str(told), "--nworkers", "2", "--nthreads", "1", "--no-dashboard"],
    ]
    processes = [subprocess.Popen(line, cwd=folder, env=environment, stdout=log, stderr=log) for line in lines]
    try:
        while not told.exists():
            assert processes[0].poll() is None, (folder / "log").read_text()
            time.sleep(0.02)
        address = json.loads(told.read_text())["address"]
        with Client(address) as client:
            client.wait_for_workers(2)
        yield address
    finally:
        for process in reversed(processes):
            process.kill()  # what hangs on it ends too
            process.wait()
        log.close()
