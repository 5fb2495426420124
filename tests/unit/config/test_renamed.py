"""Names of an earlier release are refused with the new name, wherever a configuration can have them."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import Annotated

import pytest

from tickfix.api import ConfigError, parameter
from tickfix.config import RenamedKeyError, describe_parameters, parse_config
from tickfix.registry import discover

REGISTRY = discover()
RENAMED_IN_0_2 = """
filter:fusion-pf        own_ways            use_motion_noise
filter:fusion-pf        without_fix         weight_without_fix
filter:fusion-pf        aligned             wall_alignment
filter:fusion-pf        aligned_m           alignment_length_m
filter:fusion-pf        aligned_sigma_rad   alignment_sigma_rad
filter:fusion-pf        renewed             injection_rate
filter:fusion-pf        renewed_lost        injection_rate_lost
filter:fusion-pf        renewed_sigma_m     injection_sigma_m
filter:fusion-pf        scatter_m           initial_sigma_m
filter:fusion-pf        surveyed_m          reference_sigma_m
filter:fusion-pf        astray_m            reset_distance_m
filter:fusion-pf        resample_below      ess_threshold
filter:fusion-pf        centre              point_estimate
filter:fusion-pf        remembered          error_correlation
filter:fusion-pf        freedom             student_t_dof
filter:fusion-pf        correlation_s       correlation_time_s
filter:kalman           remembered          error_correlation
filter:kalman           freedom             student_t_dof
filter:kalman           correlation_s       correlation_time_s
filter:fixes            matched             map_matching
filter:kalman-map       extrapolated_s      max_extrapolation_s
filter:kalman-reckoning place_sigma_m       position_sigma_m
filter:fading-ekf       patience            max_rejected_fixes
filter:fading-ekf       memory              forgetting_factor
filter:fading-ekf       crawl_mps           min_heading_speed_mps
filter:map-pf           patience            max_rejected_fixes
filter:map-pf           memory              forgetting_factor
filter:map-pf           crawl_mps           min_heading_speed_mps
filter:map-pf           scatter_m           jitter_sigma_m
filter:map-pf           walk                propagation
filter:map-pf           locked_out_m        reset_distance_m
filter:map-pf           locked_out_fixes    reset_after_fixes
map:regions             least_m2            min_area_m2
map:image               passage_m           min_passage_width_m
map:image               beyond_walls        snap_across_walls
pdr:steps               shortest_s          min_step_interval_s
pdr:steps               gyroscope_s         gyroscope_time_constant_s
pdr:steps               gyroscope_walk_rad  gyroscope_bias_random_walk_rad
pdr:steps               bias_walk_rad       heading_bias_random_walk_rad
pdr:steps               standing_s          stationary_after_s
pdr:gait                shortest_s          min_step_interval_s
pdr:gait                bias_walk_rad       heading_bias_random_walk_rad
pdr:gait                standing_s          stationary_after_s
pdr:gait                step_m              step_length_m
pdr:multi-threshold     bias_walk_rad       heading_bias_random_walk_rad
pdr:multi-threshold     standing_s          stationary_after_s
pdr:multi-threshold     between_s           min_peak_interval_s
pdr:pseudo-odometry     bias_walk_rad       heading_bias_random_walk_rad
pdr:pseudo-odometry     standing_s          stationary_after_s
pdr:pseudo-odometry     between_s           min_peak_interval_s
pdr:elm                 still_mps2          stationary_threshold_mps2
fingerprint:topology-knn centre             square_centre_tolerance
"""
ROWS = [(*line.split()[0].split(":"), *line.split()[1:]) for line in RENAMED_IN_0_2.strip().splitlines()]


@pytest.mark.parametrize(("kind", "name", "old", "new"), ROWS, ids=[f"{row[1]}.{row[2]}" for row in ROWS])
def test_every_renamed_parameter_is_refused_with_its_new_name(kind: str, name: str, old: str, new: str) -> None:
    stages = {"fingerprint": '{ use = "wknn" }', "filter": '{ use = "fixes" }'}
    stages[kind] = f'{{ use = "{name}", {old} = 1 }}'
    text = "[pipelines.b]\n" + "\n".join(f"{stage} = {table}" for stage, table in stages.items())
    with pytest.raises(RenamedKeyError) as error:
        parse_config(text, "mine.toml", REGISTRY)
    assert str(error.value) == f"mine.toml: pipelines.b.{kind}.{old}: renamed, use {new}"


def test_no_renaming_is_forgotten_here_and_no_old_name_is_a_parameter_again() -> None:
    declared = set()
    for offer in REGISTRY.offers:
        if offer.kind not in ("pdr", "fingerprint", "filter", "map"):
            continue
        fields = describe_parameters(offer.cls)
        formerly = {(offer.kind, offer.name, field.formerly, field.name) for field in fields if field.formerly}
        assert not {old for _, _, old, _ in formerly} & {field.name for field in fields}
        declared |= formerly
    assert declared == set(ROWS)


def test_a_swept_parameter_is_refused_too() -> None:
    text = '[pipelines.b]\nfingerprint = "wknn"\nfilter = { use = "kalman", freedom = [3.0, 4.0] }\n'
    with pytest.raises(RenamedKeyError, match=r"pipelines\.b\.filter\.freedom: renamed, use student_t_dof"):
        parse_config(text, "mine.toml", REGISTRY)


@dataclass(frozen=True)
class Settings:
    """A section with a renamed key."""

    timeout_s: Annotated[float, parameter("until it is given up", formerly="patience_s")] = 1.0


def test_settings_of_a_section_are_refused_with_the_new_name() -> None:
    text = '[live]\npatience_s = 2.0\n[pipelines.b]\nfingerprint = "wknn"\nfilter = "fixes"\n'
    with pytest.raises(ConfigError, match=r"^mine.toml: live.patience_s: renamed, use timeout_s$"):
        parse_config(text, "mine.toml", REGISTRY).section("live", Settings)


def test_the_error_survives_the_way_back_from_a_worker_process() -> None:
    error = RenamedKeyError("mine.toml: pipelines.b.filter.own_ways", "use_motion_noise")
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own bytes
    assert (str(again), again.expected) == (str(error), "use_motion_noise")
