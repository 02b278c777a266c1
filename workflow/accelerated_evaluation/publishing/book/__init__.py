"""The book of the study: notebooks and guides as one site."""
