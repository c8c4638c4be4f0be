"""Recording: any PettingZoo `ParallelEnv` or VMAS environment becomes a dataset.

    >>> from swarmdata.record import Recorder, recover
"""

from swarmdata.record.recorder import Recorder, UnfinishedEpisodeWarning
from swarmdata.record.session import Limits, recover

__all__ = ["Limits", "Recorder", "UnfinishedEpisodeWarning", "recover"]
