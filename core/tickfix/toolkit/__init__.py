"""Parts for algorithms, public and versioned apart from the interfaces in :mod:`tickfix.api`.

Plugins import from its modules: headings, step signal, calibration, particles, error model of fixes, walkable area,
surveyed and nearest-neighbour fingerprints, extreme learning machines. It stands on :mod:`tickfix.api` alone.
"""
