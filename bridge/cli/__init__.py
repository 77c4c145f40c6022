"""The verbs `truerate bridge | router | record | recording | pki`: arguments in, exit code out.

Verbs only parse and print; the work is done in the other rooms. Begin at `parser`; each verb module has `add_verbs`.
"""
