"""Requests to an engine's control port: queries and commands."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, ClassVar, Self

import zmq

from tickfix.client.connection import (
    VERSION,
    ClientError,
    HandshakeMonitor,
    Keys,
    open_client_socket,
    pack_message,
    unpack_message,
)


class RequestTimeoutError(ClientError, TimeoutError):
    """No reply within the timeout."""

    kind: ClassVar[str] = "timeout"


class RequestRefusedError(ClientError):
    """The engine answered that it cannot, and why."""

    kind: ClassVar[str] = "refused"


class Control:
    """Requests to an engine's control port, one after the other.

    Args:
        address: the engine's control port.
        keys: CURVE keys, where the engine asks for them.
        timeout_s: how long to wait for an answer.
        clock: seconds, monotonic.
    """

    def __init__(
        self,
        address: str,
        *,
        keys: Keys | None = None,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
        context: zmq.Context[zmq.Socket[bytes]] | None = None,
    ) -> None:
        """Connect; the engine need not be running before the first request.

        Raises:
            ClientError: for an address that cannot be.
        """
        self._address = address
        self._keys = keys
        self._timeout_s = timeout_s
        self._clock = clock
        self._context = context
        self._open()

    def request(self, what: str, **args: Any) -> Any:
        """Ask, and return what is answered; arguments as the protocol's page lists them.

        Raises:
            RequestTimeoutError: when there is none in time.
            AccessDeniedError: when the engine does not let this client in.
            RequestRefusedError: when the engine cannot do it, with its words.
        """
        deadline_s = self._clock() + self._timeout_s
        self._send(pack_message({"v": VERSION, "type": "request", "what": what, "args": args}), deadline_s)
        while self._wait(zmq.POLLIN, deadline_s):
            answer = unpack_message(self._socket.recv_multipart()[-1])
            if answer is None:
                continue
            if answer.get("type") == "error":
                fields = {"field": "?", "found": "?", "expected": "?", **answer}
                raise RequestRefusedError(
                    f"{what}: " + "{field}: found {found}; expected {expected}".format_map(fields)
                )
            if answer.get("type") == "reply" and answer.get("what") == what:
                if answer.get("ok"):
                    return answer.get("data")
                raise RequestRefusedError(f"{what}: {answer.get('data')}")
        # A late answer must not be taken for that of the next request: it dies with its socket.
        suspected_cause = self._handshake.suspected_cause
        self.close()
        self._open()
        raise RequestTimeoutError(
            f"{self._address}: no answer to {what!r} within {self._timeout_s:g} s; "
            + (suspected_cause or "is an engine running there, and is this its control port?")
        )

    def status(self) -> Any:
        """Return what `tickfix status` shows."""
        return self.request("status")

    def health(self) -> Any:
        """Return whether the engine keeps up, and what ails it."""
        return self.request("health")

    def counters(self) -> Any:
        """Return the counts: messages by outcome, and results of pipelines."""
        return self.request("counters")

    def devices(self) -> Any:
        """Return the devices followed."""
        return self.request("devices")

    def metrics(self) -> Any:
        """Return counters and durations in the text format of Prometheus."""
        return self.request("metrics")

    def pipelines(self) -> Any:
        """Return the pipelines and their stages."""
        return self.request("pipelines")

    def plugins(self) -> Any:
        """Return the plugins, and what is wrong with those left out."""
        return self.request("plugins")

    def configuration(self) -> Any:
        """Return the configuration that the engine runs with."""
        return self.request("configuration")

    def subscribe_info(self) -> Any:
        """Return the run, the site and the addresses of the other ports."""
        return self.request("subscribe_info")

    def primary(self, pipeline: str) -> Any:
        """Make a pipeline the primary one."""
        return self.request("primary", pipeline=pipeline)

    def drain(self) -> Any:
        """Ask the engine to refuse new messages and to finish those it has."""
        return self.request("drain")

    def stop(self) -> Any:
        """Ask the engine to shut down."""
        return self.request("stop")

    def close(self) -> None:
        """Close the socket."""
        self._handshake.close()

    def __enter__(self) -> Self:
        """Return the control itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _open(self) -> None:
        self._socket = open_client_socket(zmq.DEALER, self._keys, self._context)
        self._handshake = HandshakeMonitor(self._socket, self._address, self._keys)

    def _send(self, request: bytes, deadline_s: float) -> None:
        """Send in time or not at all: an engine that shuts this client out leaves nowhere to send to."""
        while self._wait(zmq.POLLOUT, deadline_s):
            with contextlib.suppress(zmq.Again):  # it may have done so just now
                self._socket.send(request, zmq.NOBLOCK)
                return

    def _wait(self, event: int, deadline_s: float) -> bool:
        """Wait until something can be sent, or was answered; return whether that is so in time."""
        poller = zmq.Poller()
        poller.register(self._socket, event)
        poller.register(self._handshake.monitor, zmq.POLLIN)
        while not int(self._socket.get(zmq.EVENTS)) & event:
            self._handshake.raise_if_denied()
            if not poller.poll(int(max(0.0, 1000.0 * (deadline_s - self._clock()))) + 1):
                return False
            self._handshake.read_events()
        return True
