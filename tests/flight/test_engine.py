"""One task over many items: nothing lost, nothing twice, whatever happens to a worker."""

import os
import signal
import time
from pathlib import Path

import pytest
from tasks import deadly, slow, square

from gcs_health.engine import DIED, each
from gcs_health.errors import ConfigError


@pytest.mark.parametrize("workers", [1, 2])
def test_an_item_that_raises_is_told_and_the_rest_goes_on(workers: int) -> None:
    done = list(each(square, range(12), workers=workers))
    assert sorted(one.item for one in done) == list(range(12))
    assert {one.item: one.result for one in done if not one.error} == {k: k * k for k in range(12) if k != 3}
    assert [one.error for one in done if one.error] == ["ValueError: three is not liked"]


def test_an_item_that_kills_its_worker_is_told_and_the_rest_goes_on() -> None:
    done = list(each(deadly, range(9), workers=2))
    assert sorted(one.item for one in done) == list(range(9))
    assert {one.item: one.error for one in done if one.error} == {4: DIED}


def test_a_cluster_that_is_not_there_is_one_clear_line() -> None:
    with pytest.raises(ConfigError, match="cannot reach a Dask scheduler"):
        list(each(square, [1], scheduler="tcp://127.0.0.1:9"))


@pytest.mark.filterwarnings("default")  # Dask's own, about a worker that is gone
def test_a_cluster_that_loses_a_worker_does_every_item_once(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    items = [f"{k}@{tmp_path}" for k in range(14)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        with distributed.Client(cluster) as client:
            folder = str(Path(__file__).parent)
            client.run(lambda: __import__("sys").path.insert(0, folder))
        killed, done = 0, []
        for one in each(slow, items, scheduler=cluster.scheduler_address):
            done.append(one)
            if len(done) == 4:  # whoever works now is killed in the middle of it
                begun = sorted(tmp_path.iterdir(), key=lambda p: p.stat().st_mtime)
                killed = int(begun[-1].suffix[1:])
                os.kill(killed, signal.SIGKILL)
                with distributed.Client(cluster) as client:  # who takes its place must find the task too
                    deadline = time.monotonic() + 20.0
                    while (
                        killed in (pids := client.run(os.getpid, on_error="ignore").values()) or len(pids) < 1
                    ):
                        assert time.monotonic() < deadline
                    client.run(lambda: __import__("sys").path.insert(0, folder), on_error="ignore")
    assert killed
    assert not any(one.error for one in done)
    assert sorted(one.result for one in done) == sorted(map(str, range(14)))
    assert len({path.stem for path in tmp_path.iterdir()}) == 14
