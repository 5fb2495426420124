"""ZeroMQ: sensors in, positions out, control; who may come in, and how much of it."""

from tickfix.ports.control_port import ASK_LOOP
from tickfix.ports.hub import Hub, PortAddresses
from tickfix.ports.inbound_queue import ControlCommand, InboundMessage
from tickfix.ports.peers import Peer
from tickfix.ports.port_settings import Clock, PeerLimits, PortSettings
from tickfix.ports.publishers import Publication

__all__ = [
    "ASK_LOOP",
    "Clock",
    "ControlCommand",
    "Hub",
    "InboundMessage",
    "Peer",
    "PeerLimits",
    "PortAddresses",
    "PortSettings",
    "Publication",
]
