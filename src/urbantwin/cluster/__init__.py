"""Ray clusters: the worker pool of `urbantwin.processes` on many machines."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.cluster.connection import Cluster, connected
    from urbantwin.cluster.workers import ClusterWorkers

__all__ = ["Cluster", "ClusterWorkers", "connected"]

names_on_demand(__name__)
