"""Command-line verbs `truerate bridge | router | record | recording | pki`: arguments in, exit code out.

Verbs only parse and print; the other rooms do the work. Begin at `parser`; each verb module has `add_verbs`.
"""
