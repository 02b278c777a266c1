"""The answer: the posterior of the crash probability over all laws that the records support.

The laws are scored on held-out records, and the scores determine their weights. Further modules check the
answer, and compare it with counted crashes.
"""
