"""The experiments of published papers, run again on simulated twins of their sites.

Each paper has a subpackage with twin, experiment and claims.
"""
