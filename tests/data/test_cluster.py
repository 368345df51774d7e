"""Tasks on processes and on a Dask cluster: a real scheduler, two workers, and what may become of them."""

import os
import signal
import socket
import sys
from pathlib import Path

import pytest
from cluster_tasks import slowly_doubled

from data.common import processes as of_data
from data.common.cli import run_command
from data.common.processes import completed, connected
from sgslam.cli.batch import main as batch

pytestmark = pytest.mark.slow


def test_every_task_has_one_result_although_a_worker_is_killed(scheduler: str) -> None:
    with connected(scheduler) as client:
        pids = list(client.run(os.getpid).values())
    answers = []
    for answer in completed(slowly_doubled, range(60), scheduler=scheduler):
        if not answers:
            os.kill(pids[0], signal.SIGKILL)
        answers.append(answer)
    assert sorted(answers) == [(n, 2 * n) for n in range(60)] == sorted(completed(slowly_doubled, range(60), 2))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:9"], "tcp://127.0.0.1:9"),
        (["--scheduler", "SILENT"], "no Dask scheduler"),
        (["--jobs", "2", "--scheduler", "HERE"], "--jobs"),
        (["--scheduler", "WITHOUT DASK"], "pip install 'sgslam[cluster]'"),
    ],
)
def test_a_users_mistake_is_one_line(
    scheduler: str, tmp_path: Path, given: list[str], message: str, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(of_data, "PATIENCE_S", 1.0)
    (tmp_path / "jobs.csv").write_text("scans\nhere\n")
    with socket.create_server(("127.0.0.1", 0)) as silent:
        addresses = {"HERE": scheduler, "SILENT": f"tcp://127.0.0.1:{silent.getsockname()[1]}"}
        with monkeypatch.context() as patch, pytest.raises(SystemExit) as ended:
            if given[-1] == "WITHOUT DASK":
                patch.setitem(sys.modules, "distributed", None)
                addresses[given[-1]] = scheduler
            run_command(lambda: batch([str(tmp_path / "jobs.csv"), *(addresses.get(w, w) for w in given)]))
    error = capfd.readouterr().err
    assert ended.value.code == 2 and message in error and len(error.splitlines()) == 1
