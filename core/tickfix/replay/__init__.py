"""Off-line drivers: recordings from files through the kernel, surveys that train models, and processes to do it on
several cores.
"""

from tickfix.replay.driver import ReplayResult, replay_recording, start_at_first_waypoint
from tickfix.replay.process_pool import available_cores, parallel_map
from tickfix.replay.site_survey import survey_and_train, train, trainable_choices

__all__ = [
    "ReplayResult",
    "available_cores",
    "parallel_map",
    "replay_recording",
    "start_at_first_waypoint",
    "survey_and_train",
    "train",
    "trainable_choices",
]
