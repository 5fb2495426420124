"""The report of a comparison.

``report_data`` holds what all renderers show; ``terminal``, ``html_report``, ``charts``, ``walk_plans`` and
``report_files`` render it.
"""
