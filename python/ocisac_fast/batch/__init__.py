"""Many recordings: one table of all, on one machine or on a Dask cluster."""

from ocisac_fast.batch.campaign import (
    Outcome as Outcome,
    Progress as Progress,
    measure_recordings as measure_recordings,
)
from ocisac_fast.batch.engines import cluster as cluster
from ocisac_fast.batch.jobs import ClusterError as ClusterError, VersionError as VersionError
from ocisac_fast.batch.measuring import measure_recording as measure_recording
from ocisac_fast.batch.results import (
    ResultsError as ResultsError,
    read_failures as read_failures,
    read_results as read_results,
)
from ocisac_fast.batch.summary import (
    RecordingSummary as RecordingSummary,
    Summary as Summary,
    summarize as summarize,
)
from ocisac_fast.batch.task import Task as Task
from ocisac_fast.batch.workers import Workers as Workers
