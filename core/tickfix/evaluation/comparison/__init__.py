"""A comparison: many walks, many seeds, many pipelines, and what is left of them.

``grounds`` and ``folds`` say where to walk; ``trial`` runs one walk and keeps an ``outcome`` for each pipeline, which
``store`` finds again after an interruption; ``points`` and ``pooled`` bring outcomes together; ``result`` compares.
"""
