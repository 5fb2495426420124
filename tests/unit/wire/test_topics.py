"""Topics tell site, floor, device and pipeline apart by prefix, whatever the names."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.wire import WireError, parse_topic, stream_topics, topic_segment

NAME = st.text(st.characters(exclude_categories=["Cs"]), max_size=10) | st.sampled_from(["-", "a/b", "%2D", "é", ""])


def test_the_topics_of_an_estimate():
    said = stream_topics("estimate", "mall", "F1", "phone/7", "fusion")
    assert said == (b"estimate/mall/F1/phone%2F7/fusion", b"device/mall/phone%2F7/fusion")
    assert stream_topics("revision", "mall", None, "é", "wifi") == (b"revision/mall/-/%C3%A9/wifi",)


@given(NAME, st.none() | NAME, NAME, NAME)
def test_names_come_back_from_their_topics(site, floor, device, pipeline):
    by_floor, by_device = stream_topics("estimate", site, floor, device, pipeline)
    assert parse_topic(by_floor) == ("estimate", site, floor, device, pipeline)
    assert parse_topic(by_device) == ("device", site, None, device, pipeline)


@given(NAME, NAME)
def test_no_name_reaches_into_the_next_segment(one, other):
    assert "/" not in topic_segment(one)
    assert (topic_segment(one) == topic_segment(other)) is (one == other)


def test_lone_surrogates_have_a_segment_too():
    assert topic_segment("\ud800") == "%5Cud800"


@pytest.mark.parametrize("topic", [b"", b"heartbeat", b"estimate/a/b", b"device/a/b/c/d", b"\xff/a/b/c/d"])
def test_other_topics_are_refused(topic):
    with pytest.raises(WireError, match="expected estimate/SITE/FLOOR/DEVICE/PIPELINE"):
        parse_topic(topic)
