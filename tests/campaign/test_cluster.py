"""Two Dask workers on this machine give the table of local processes, also when one of them is lost."""

import os
import warnings
from collections import Counter
from collections.abc import Iterator

import pytest
from stand_in import carry_out, processes, requests, starts, table

distributed = pytest.importorskip("distributed")

RUNS = 100

pytestmark = [
    pytest.mark.slow,
    # sockets that Dask closes late, in threads of its own
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning"),
]


@pytest.fixture
def cluster() -> Iterator[str]:
    words = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "host": "127.0.0.1"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with distributed.LocalCluster(**words, dashboard_address=None, silence_logs="CRITICAL") as local:
            yield local.scheduler_address


def test_a_cluster_gives_the_table_of_local_processes_and_survives_the_loss_of_a_worker(cluster, tmp_path):
    local, undisturbed, disturbed = (tmp_path / name for name in ("local", "cluster", "loss"))
    wanted = table(carry_out(local, requests(local, RUNS)))
    assert table(carry_out(undisturbed, requests(undisturbed, RUNS), scheduler=cluster)) == wanted
    assert (Counter(starts(undisturbed)), len(processes(undisturbed))) == (Counter(range(RUNS)), 2)
    assert os.getpid() not in processes(undisturbed)
    listed = requests(disturbed, RUNS, mishaps={RUNS // 2: "kills once"})
    assert table(carry_out(disturbed, listed, scheduler=cluster)) == wanted
    assert Counter(starts(disturbed))[RUNS // 2] == 2  # begun again on another worker
