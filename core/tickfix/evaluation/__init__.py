"""How good a track is: errors at waypoints, figures, comparisons and pictures.

One walk goes ``track`` → ``scoring`` → ``summary``; ``coverage`` says where the survey has been, ``figures`` what the
numbers mean, ``tables`` and ``pictures`` show them.
"""
