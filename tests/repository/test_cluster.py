"""Tasks on processes and on a Dask cluster: a real scheduler, two workers, and what may become of them."""

import os
import signal
import socket
import sys
from functools import partial
from itertools import count, islice
from pathlib import Path

import pytest
from cluster_tasks import deadly, failing, pretend, slowly_doubled

from data.common import cluster as of_data
from data.common.cli import run_command
from data.common.cluster import RETRIES, completed, connected, in_order
from data.common.errors import UserError
from matching.train import main as train

pytestmark = pytest.mark.slow


def test_with_a_worker_killed_every_task_has_one_result(scheduler: str) -> None:
    answers = []
    with connected(scheduler) as client:
        pids = list(client.run(os.getpid).values())
    for answer in completed(slowly_doubled, range(60), scheduler=scheduler):
        if not answers:
            os.kill(pids[0], signal.SIGKILL)
        answers.append(answer)
    assert sorted(answers) == [(n, 2 * n) for n in range(60)] == sorted(completed(slowly_doubled, range(60), 2))


@pytest.mark.long
def test_a_task_that_ends_its_worker_each_time_fails_alone(scheduler: str) -> None:
    # tasks that waited at the same workers may be blamed as well
    answers = dict(completed(deadly, range(6), scheduler=scheduler))
    assert answers.keys() == set(range(6)) and "different workers" in str(answers[3])


@pytest.mark.parametrize("error", [ValueError, TimeoutError, UserError])
def test_a_task_that_raises_is_tried_again(scheduler: str, tmp_path: Path, error: type[Exception]) -> None:
    log = tmp_path / "log"
    answers = dict(completed(partial(failing, log, error, 9), range(6), scheduler=scheduler))
    assert isinstance(answers.pop(3), error) and answers == {n: 2 * n for n in (0, 1, 2, 4, 5)}
    assert len(log.read_text().splitlines()) == 1 + RETRIES
    log.unlink()
    answers = dict(completed(partial(failing, log, error, RETRIES), range(6), scheduler=scheduler))
    assert answers == {n: 2 * n for n in range(6)}


def test_answers_in_order_with_and_without_an_end(scheduler: str) -> None:
    assert list(islice(in_order(slowly_doubled, count(), scheduler), 9)) == list(range(0, 18, 2))
    assert list(in_order(slowly_doubled, range(30), scheduler)) == list(range(0, 60, 2))


def test_a_worker_of_another_build_is_refused(scheduler: str) -> None:
    with connected(scheduler) as client:
        client.run(pretend, "0.0.9")
        try:
            with pytest.raises(UserError, match=r"^the worker tcp://.* must have sgslam .*, but has: 0\.0\.9"):
                list(completed(slowly_doubled, range(3), scheduler=scheduler))
        finally:
            client.run(pretend, None)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:9"], "tcp://127.0.0.1:9: no Dask scheduler with workers answers there"),
        (["--scheduler", "127.0.0.1"], "write tcp://HOST:PORT"),
        (["--scheduler", "SILENT"], "no Dask scheduler with workers answers there"),
        (["--scheduler", "WORKER"], "it is a worker"),
        (["--workers", "2", "--scheduler", "HERE"], "not allowed with argument --workers"),
    ],
)
def test_a_users_mistake_is_one_line(
    scheduler: str, tmp_path: Path, given: list[str], message: str, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(of_data, "PATIENCE_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent, connected(scheduler) as client:
        addresses = {
            "HERE": scheduler,
            "SILENT": f"tcp://127.0.0.1:{silent.getsockname()[1]}",
            "WORKER": next(iter(client.nthreads())),
        }
        with pytest.raises(SystemExit) as ended:
            run_command(lambda: train(["--out", str(tmp_path / "out"), *(addresses.get(w, w) for w in given)]))
    error = capfd.readouterr().err
    assert ended.value.code == 2 and message in error and len(error.splitlines()) == 1


def test_without_dask_the_message_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: train(["--out", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9"]))
    assert ended.value.code == 2 and "pip install 'sgslam[cluster]'" in capfd.readouterr().err
