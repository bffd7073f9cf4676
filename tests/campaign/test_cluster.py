"""Two Dask workers on this machine give the table of local processes, also when one of them is lost."""

import os
import warnings
from collections import Counter
from collections.abc import Iterator

import pytest
from stand_in import FUNCTION, processes, requests, starts, table

from taichi_erosion.campaign.execute import execute
from taichi_erosion.campaign.ledger import close_ledger, open_ledger

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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs="CRITICAL",
        ) as local:
            yield local.scheduler_address


def carry_out(folder, scheduler=None, mishaps=None):
    store = open_ledger(folder)
    found = execute(
        requests(folder, RUNS, mishaps=mishaps), store, workers=2, scheduler=scheduler, function=FUNCTION
    )
    close_ledger(store)
    return table(found)


def test_a_cluster_gives_the_table_of_local_processes_and_survives_the_loss_of_a_worker(cluster, tmp_path):
    local, undisturbed, disturbed = (tmp_path / name for name in ("local", "cluster", "loss"))
    wanted = carry_out(local)
    assert carry_out(undisturbed, cluster) == wanted
    assert Counter(starts(undisturbed)) == Counter(range(RUNS))
    assert len(processes(undisturbed)) == 2
    assert os.getpid() not in processes(undisturbed)
    assert carry_out(disturbed, cluster, {RUNS // 2: "kills once"}) == wanted
    assert Counter(starts(disturbed))[RUNS // 2] == 2  # begun again on another worker
