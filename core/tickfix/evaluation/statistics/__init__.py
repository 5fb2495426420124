"""Whether a difference can be believed: paired differences, intervals, tests, and a verdict in words.

``samples`` pairs the errors of two pipelines; ``quantities`` are what is compared; ``bootstrap`` gives intervals,
``permutation`` p-values, ``holm`` corrects them for many comparisons, ``power`` says how many walks would be needed,
and ``verdict`` says it all in a sentence. ``docs/compare.md`` explains the choices.
"""
