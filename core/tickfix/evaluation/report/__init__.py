"""The report of a comparison: one HTML page that needs no network, and the same as Markdown, JSON and CSV.

``charts`` and ``sweeps`` draw figures, ``plans`` walks on their floors; ``trouble`` says what went wrong on a walk;
``tables`` holds what page and Markdown both show; ``page`` and ``markdown`` put it together, ``folder`` writes it.
"""
