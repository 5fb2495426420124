"""The experiments of [wang2015] on a twin of its site.

``site`` and ``walks`` are the twin: what the text prints as printed, what it does not print chosen, listed in
``choices`` and fixed before any result was seen.
"""
