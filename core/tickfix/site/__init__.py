"""A building as a value: floors, radio map and survey, made from walks with waypoints or from fingerprints."""

from tickfix.site.fingerprint_table import FingerprintTable
from tickfix.site.site import HeldOutWalk, Site, file_sha256, is_site, load_site, save_site
from tickfix.site.survey_builder import SurveyResult, read_floor_plans, survey_recordings
from tickfix.site.waypoints import Leg, SurveyTrack, assign_chains, is_held_out, split_into_legs, to_survey_walk

__all__ = [
    "FingerprintTable",
    "HeldOutWalk",
    "Leg",
    "Site",
    "SurveyResult",
    "SurveyTrack",
    "assign_chains",
    "file_sha256",
    "is_held_out",
    "is_site",
    "load_site",
    "read_floor_plans",
    "save_site",
    "split_into_legs",
    "survey_recordings",
    "to_survey_walk",
]
