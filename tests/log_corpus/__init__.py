"""A corpus of logs in the forms of public exporters, each with the truth that it was made from."""
