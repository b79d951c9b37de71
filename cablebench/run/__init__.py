"""Running the episodes of a protocol and keeping their records."""

from cablebench.run.evaluation import Progress, evaluate, run_episode
from cablebench.run.store import ResultStore, StoreWarning

__all__ = ["Progress", "ResultStore", "StoreWarning", "evaluate", "run_episode"]
