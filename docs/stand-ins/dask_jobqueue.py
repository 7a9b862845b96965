"""Stand-in of dask-jobqueue: the jobs are processes of this machine."""

from distributed import LocalCluster


class SLURMCluster(LocalCluster):
    """Takes the arguments of the page; ``scale`` starts workers here."""

    def __init__(self, *, cores: int, processes: int, memory: str, walltime: str, queue: str) -> None:
        super().__init__(n_workers=0, threads_per_worker=cores // processes, dashboard_address=":0")

    def scale(self, jobs: int) -> None:
        super().scale(jobs)
