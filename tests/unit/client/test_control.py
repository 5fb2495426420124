"""Control asks and is answered, refused, or told that nobody is there."""

from __future__ import annotations

from threading import Event, Thread

import pytest

from tickfix.client import Control, RequestRefusedError, RequestTimeoutError
from tickfix.wire import (
    CONTROL_REQUESTS,
    VERSION,
    ControlReply,
    ErrorReply,
    WireError,
    decode_request,
    encode_engine_message,
    error_reply,
)

PATIENCE_S = 60.0


@pytest.fixture
def answering(sockets):
    """Return a function that answers the next requests beside the test."""
    threads, ended = [], Event()

    def answer(*answers):
        def serve():
            for make in answers:
                while not sockets.router.poll(20):
                    if ended.is_set():
                        return
                peer, data = sockets.router.recv_multipart()
                try:
                    request = decode_request(data)
                except WireError as error:
                    sockets.say(peer, error_reply(error))
                else:
                    for reply in make(request):
                        sockets.router.send_multipart(
                            [peer, reply if isinstance(reply, bytes) else encode_engine_message(reply)]
                        )

        thread = Thread(target=serve)
        thread.start()
        threads.append(thread)

    yield answer
    ended.set()
    for thread in threads:
        thread.join()


def ok(request):
    return [ControlReply(v=VERSION, what=request.what, ok=True, data=[request.what, request.args])]


def test_every_request_has_a_method(sockets, answering):
    control = sockets.keep(Control(sockets.address, timeout_s=PATIENCE_S, context=sockets.context))
    answering(*[ok] * len(CONTROL_REQUESTS))
    for what in CONTROL_REQUESTS:
        method = getattr(control, what.replace("-", "_"))
        args = {"pipeline": "fusion"} if what == "primary" else {}
        assert method(**args) == [what, args]


def test_a_refusal_says_why(sockets, answering):
    control = sockets.keep(Control(sockets.address, timeout_s=PATIENCE_S, context=sockets.context))
    answering(
        lambda request: [ControlReply(v=VERSION, what=request.what, ok=False, data="no pipeline 'x'")],
        lambda request: [
            ErrorReply(v=VERSION, outcome="malformed", field="args.pipeline", found="3", expected="a name")
        ],
        ok,
    )
    with pytest.raises(RequestRefusedError, match="primary: no pipeline 'x'"):
        control.primary("x")
    with pytest.raises(RequestRefusedError, match=r"args\.pipeline: found 3; expected a name"):
        control.primary("x")
    with pytest.raises(RequestRefusedError, match="what: found 'dance'; expected status"):
        control.request("dance")


def test_when_nobody_answers_it_says_what_to_look_at(sockets):
    control = sockets.keep(Control(sockets.address, timeout_s=0.05, context=sockets.context))
    with pytest.raises(RequestTimeoutError, match=r"no answer to 'status' within 0\.05 s; is an engine running there"):
        control.status()


def test_a_late_answer_is_not_taken_for_the_next(sockets, answering):
    control = sockets.keep(Control(sockets.address, timeout_s=0.05, context=sockets.context))
    while not sockets.router.poll(0):  # a slow machine connects later than that
        with pytest.raises(TimeoutError):
            control.request("status", impatient=True)
    late, _ = sockets.router.recv_multipart()
    control._timeout_s = PATIENCE_S

    def answer(request):
        if request.args:  # another of those that were not answered in time
            return []
        sockets.router.send_multipart(
            [late, encode_engine_message(ControlReply(v=VERSION, what="status", ok=True, data="late"))]
        )
        return [ControlReply(v=VERSION, what="status", ok=True, data="in time")]

    answering(*[answer] * 1000)
    assert control.status() == "in time"


def test_what_is_no_answer_is_passed_over(sockets, answering):
    control = sockets.keep(Control(sockets.address, timeout_s=PATIENCE_S, context=sockets.context))
    other = ControlReply(v=VERSION, what="health", ok=True, data="other")
    answering(lambda request: [b"\xc1", other, *ok(request)])
    assert control.status() == ["status", {}]
