"""Comparison of pipelines.

Many walks, seeds and sites. ``evaluation_sites`` says where, ``trials`` runs, ``trial_outcomes`` stores,
``pooled_metrics`` pools and ``comparison_result`` compares.
"""
