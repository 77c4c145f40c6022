"""Command-line verbs `truerate bridge | router | record | recording | pki`: arguments to parse, exit codes to return.

The verbs parse and print; other packages do the work. Begin at `parser`; each verb module has a function `add_verbs`.
"""
