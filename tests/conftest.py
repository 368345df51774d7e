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
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # on small arrays more threads only wait for each other
    os.environ.setdefault(_name, "1")
# a shell that runs the tests in the background has all of their children ignore interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """IFC files are read once for all tests, by today's code: what the user's cache holds plays no part."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SGSLAM_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a Dask scheduler with two workers of one thread, which are started again when they die."""
    from distributed import Client  # slow to import

    folder = tmp_path_factory.mktemp("cluster")
    told = folder / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": f"{HERE.parent}{os.pathsep}{HERE}", "OMP_NUM_THREADS": "1"}
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
