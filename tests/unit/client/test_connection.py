"""Sockets of clients, and what they must not ask libzmq for."""

from __future__ import annotations

import zmq

from tickfix.client.connection import open_client_socket


def test_a_client_asks_for_no_heartbeats_that_could_abort_it_but_tcp_looks_after_the_connection():
    context = zmq.Context()
    with open_client_socket(zmq.SUB, None, context) as socket:
        assert socket.getsockopt(zmq.HEARTBEAT_IVL) == 0
        assert socket.getsockopt(zmq.TCP_KEEPALIVE) == 1
        idle_s, interval_s, count = map(
            socket.getsockopt, (zmq.TCP_KEEPALIVE_IDLE, zmq.TCP_KEEPALIVE_INTVL, zmq.TCP_KEEPALIVE_CNT)
        )
        assert idle_s + interval_s * count == 25
        assert socket.getsockopt(zmq.TCP_MAXRT) == 25_000
    context.term()
