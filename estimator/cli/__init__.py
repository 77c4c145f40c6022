"""The command `truerate`: one module a verb. Arguments in, exit code out.

Begin at `main`, which loads only the module of the verb that is asked for.
"""
