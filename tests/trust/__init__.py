"""Counts behind the claim that answers can be trusted; `python -m trust` prints them all, see `__main__`.

Every attempt follows from its seed alone. The tests take a small share of each, by the same functions.
"""
