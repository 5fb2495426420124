"""Evaluation of tracks against truth.

Scoring, metrics, paired statistics, comparison of pipelines, reports and pictures.
"""
