"""Off-line drivers: recordings from files through the kernel, surveys that train models, and processes to do it on
several cores.
"""
