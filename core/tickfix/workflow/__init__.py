"""tickfix from Python: the functions and classes that ``import tickfix`` offers, and the command line calls.

Each module is one step of the work: :mod:`~tickfix.workflow.walks` reads and builds recordings,
:mod:`~tickfix.workflow.pipelines` understands the ways to name pipelines, :mod:`~tickfix.workflow.sites` surveys,
:mod:`~tickfix.workflow.tracking` tracks, :mod:`~tickfix.workflow.comparing` compares, and
:mod:`~tickfix.workflow.fingerprint_estimator` evaluates fingerprints on arrays.
"""
