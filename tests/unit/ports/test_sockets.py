"""Options that all sockets of the ports share, and what depends on them."""

from __future__ import annotations

import pytest
import zmq

from tickfix.ports.sockets import open_port_socket, open_router_socket


@pytest.mark.parametrize("kind", [zmq.ROUTER, zmq.XPUB])
def test_sockets_are_bounded_close_at_once_and_send_no_zmtp_heartbeats(kind: int) -> None:
    context = zmq.Context()
    if kind == zmq.ROUTER:
        socket = open_router_socket(context, high_water_mark=7, frame_bytes=1_000)
    else:
        socket = open_port_socket(context, kind, high_water_mark=7, frame_bytes=1_000)
    values = {
        name: socket.getsockopt(getattr(zmq, name))
        for name in ("LINGER", "SNDHWM", "RCVHWM", "MAXMSGSIZE", "HEARTBEAT_IVL", "TCP_KEEPALIVE")
    }
    socket.close()
    context.term()
    # A heartbeat that is due on a connection which broke with a full queue aborts the process (libzmq issue 4767).
    assert values == {
        "LINGER": 0, "SNDHWM": 7, "RCVHWM": 7, "MAXMSGSIZE": 1_000, "HEARTBEAT_IVL": 0, "TCP_KEEPALIVE": 1,
    }  # fmt: skip


def test_routing_ids_begin_at_another_place_in_every_hub() -> None:
    first = set()
    for _ in range(4):
        context = zmq.Context()
        router = open_router_socket(context, high_water_mark=7, frame_bytes=1_000)
        dealer = context.socket(zmq.DEALER)
        router.bind("inproc://here")
        dealer.connect("inproc://here")
        dealer.send(b"")
        first.add(router.recv_multipart()[0])
        dealer.close(0)
        router.close(0)
        context.term()
    assert len(first) == 4
