"""The metrics of a comparison, one module each; ``docs/metrics.md`` has formula and source of every one.

``points`` says where truth is known, ``pointwise`` what a pipeline said there. ``penalised``, ``circular``, ``regions``
and ``curves`` are about those points; ``availability``, ``walls``, ``smoothness`` and ``standing`` about whole tracks;
``cost`` about the time that stages took.
"""
