"""ZeroMQ: sensors in, positions out, control; who may come in, and how much of it."""

from tickfix.ports.clock import Clock
from tickfix.ports.hub import Addresses, Hub
from tickfix.ports.intake import Command, Incoming
from tickfix.ports.peers import Peer
from tickfix.ports.positions import Said
from tickfix.ports.settings import PeerLimits, PortSettings

__all__ = ["Addresses", "Clock", "Command", "Hub", "Incoming", "Peer", "PeerLimits", "PortSettings", "Said"]
