"""A run from case to result: prediction, intervals, search of a plan.

May import `report`, `recording` and below.
"""
