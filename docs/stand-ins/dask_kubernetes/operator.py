"""Stand-in of dask-kubernetes: the pods are processes of this machine."""

from distributed import LocalCluster


class KubeCluster(LocalCluster):
    """Takes the arguments of the page."""

    def __init__(self, *, name: str, image: str, worker_command: str) -> None:
        super().__init__(name=name, n_workers=0, threads_per_worker=1, dashboard_address=":0")
