"""The book of the study: notebooks, guides and how they become one site."""
