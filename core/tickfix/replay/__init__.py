"""Off-line drivers: recordings from files through the kernel, surveys that train models, and processes to do it on
several cores.
"""

from tickfix.replay.driver import ReplayResult, replay_recording, start_at_first_waypoint
from tickfix.replay.process_pool import available_cores, parallel_map
from tickfix.replay.recording_files import (
    FoundRecordings,
    LoadedRecording,
    Progress,
    RecordingFile,
    find_recordings,
    no_progress,
    read_recordings,
)
from tickfix.replay.site_survey import (
    TrainedSite,
    WalksWithFloors,
    read_walks,
    site_context,
    survey_and_train,
    survey_files,
    train,
    trainable_choices,
)

__all__ = [
    "FoundRecordings",
    "LoadedRecording",
    "Progress",
    "RecordingFile",
    "ReplayResult",
    "TrainedSite",
    "WalksWithFloors",
    "available_cores",
    "find_recordings",
    "no_progress",
    "parallel_map",
    "read_recordings",
    "read_walks",
    "replay_recording",
    "site_context",
    "start_at_first_waypoint",
    "survey_and_train",
    "survey_files",
    "train",
    "trainable_choices",
]
