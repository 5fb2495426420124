"""What this package offers."""

from __future__ import annotations

from tickfix.api import hookimpl
from tickfix_fingerprint.cross_correlation import Fncc, Ncc
from tickfix_fingerprint.elm_knn import ElmKnn
from tickfix_fingerprint.knn import Knn, Wknn
from tickfix_fingerprint.topology_knn import TopologyKnn

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> list[type]:
    """Offer the fingerprints."""
    return [ElmKnn, Fncc, Knn, Ncc, TopologyKnn, Wknn]
