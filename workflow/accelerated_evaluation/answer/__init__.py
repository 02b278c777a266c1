"""The answer: the posterior of the crash probability over all laws that the records support.

It has three rooms, each of which imports only earlier ones: the candidate laws, the ways to an answer, and
what follows from it. The modules beside them use all three.
"""
