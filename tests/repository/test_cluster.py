"""Tasks on a Dask cluster: a real scheduler, two workers, and what may become of them."""

import os
import signal
import socket
import sys
from functools import partial
from pathlib import Path

import pytest
from cluster_tasks import deadly, doubled, failing, pretend, slowly_doubled

from data.common import cluster as of_data
from data.common.children import ProcessEndedError
from data.common.cli import run_command
from data.common.cluster import RETRIES, connected
from data.common.errors import UserError
from matching.train import main as train

pytestmark = pytest.mark.slow


def number(n: int) -> str:
    return f"number {n}"


def test_with_a_worker_killed_every_task_has_one_result(scheduler: str) -> None:
    answers = []
    with connected(scheduler) as cluster:
        for answer in cluster.over(range(60), slowly_doubled, number):
            if not answers:
                os.kill(next(iter(cluster._client.run(os.getpid).values())), signal.SIGKILL)
            answers.append(answer)
    assert sorted(answers) == [(n, 2 * n) for n in range(60)]


def test_a_task_that_ends_its_worker_each_time_is_named(scheduler: str) -> None:
    with connected(scheduler) as cluster, pytest.raises(UserError, match=r"^number \d: .*4 different workers"):
        # Dask may name a task that waited at the same workers
        list(cluster.over(range(6), deadly, number))


@pytest.mark.parametrize(
    ("error", "tries", "message"),
    [
        (ValueError, 1 + RETRIES, r"^number 3: is too much"),
        (TimeoutError, 1 + RETRIES, r"^number 3: is too much"),
        (ProcessEndedError, 1 + RETRIES, r"^three\nis too much"),
        (UserError, 1, r"^the worker tcp://127.0.0.1:\d+: three\nis too much"),
    ],
)
def test_a_task_that_raises_is_tried_again_unless_it_is_a_users_mistake(
    scheduler: str, tmp_path: Path, error: type[Exception], tries: int, message: str
) -> None:
    log = tmp_path / "log"
    with connected(scheduler) as cluster:
        with pytest.raises(UserError, match=message):
            list(cluster.over(range(6), partial(failing, log, error, 9), number))
        assert len(log.read_text().splitlines()) == tries
        if tries > 1:
            log.unlink()
            assert len(list(cluster.over(range(6), partial(failing, log, error, RETRIES), number))) == 6


def test_answers_in_order_without_end(scheduler: str) -> None:
    with connected(scheduler) as cluster:
        answers = cluster.in_order(iter(int, 1), doubled, number)
        assert [next(answers) for _ in range(9)] == [0] * 9
        assert list(cluster.in_order(range(30), doubled, number)) == list(range(0, 60, 2))


def test_a_worker_without_the_same_file_is_refused(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weights.pt").write_text("seen from here only")
    monkeypatch.chdir(tmp_path)
    with connected(scheduler) as cluster:
        assert len(list(cluster.over(range(3), doubled, number, [tmp_path / "weights.pt", tmp_path]))) == 3
        with pytest.raises(UserError, match=r"^the worker tcp://.*weights\.pt must be there"):
            list(cluster.over(range(3), doubled, number, ["weights.pt"]))


def test_a_worker_of_another_build_is_refused(scheduler: str) -> None:
    message = r"^the worker tcp://.* must have sgslam .*, but has: 0\.0\.9"
    with connected(scheduler) as cluster:
        cluster._client.run(pretend, "0.0.9")
        try:
            with pytest.raises(UserError, match=message):
                list(cluster.over(range(3), doubled, number))
            with pytest.raises(UserError, match=message), connected(scheduler):
                pass
        finally:
            cluster._client.run(pretend, None)


def test_it_ends_without_workers_and_without_a_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    for setting in ("CONNECTING_S", "WORKERLESS_S", "LOOK_EVERY_S"):
        monkeypatch.setattr(of_data, setting, 1.0)
    with LocalCluster(n_workers=1, processes=False, protocol="tcp", dashboard_address=":0") as local:
        with connected(local.scheduler_address) as cluster, pytest.raises(UserError, match="no Dask worker for 1 s"):
            for _ in cluster.over(range(1000), slowly_doubled, number):
                local.scale(0)
        with pytest.raises(UserError, match="no Dask worker for 1 s"), connected(local.scheduler_address):
            pass
        local.scale(1)
        with pytest.raises(UserError, match="connection was lost"), connected(local.scheduler_address) as cluster:
            for _ in cluster.over(range(1000), slowly_doubled, number):
                local.close()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:9"], "tcp://127.0.0.1:9: no Dask scheduler answers there"),
        (["--scheduler", "127.0.0.1"], "write tcp://HOST:PORT"),
        (["--scheduler", "SILENT"], "no Dask scheduler answers there"),
        (["--scheduler", "WORKER"], "it is a Worker"),
        (["--workers", "2", "--scheduler", "HERE"], "not allowed with argument --workers"),
    ],
)
def test_a_users_mistake_is_one_line(
    scheduler: str, tmp_path: Path, given: list[str], message: str, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(of_data, "CONNECTING_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent, connected(scheduler) as cluster:
        addresses = {
            "HERE": scheduler,
            "SILENT": f"tcp://127.0.0.1:{silent.getsockname()[1]}",
            "WORKER": next(iter(cluster._client.nthreads())),
        }
        with pytest.raises(SystemExit) as ended:
            run_command(lambda: train(["--out", str(tmp_path / "out"), *(addresses.get(w, w) for w in given)]))
    error = capfd.readouterr().err
    assert ended.value.code == 2 and message in error and len(error.splitlines()) == 1


def test_without_dask_it_is_told_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: train(["--out", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9"]))
    assert ended.value.code == 2 and "pip install 'sgslam[cluster]'" in capfd.readouterr().err
